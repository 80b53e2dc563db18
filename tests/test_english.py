"""Words that may not come back, in what a person reads: each has a plainer one beside it."""

import ast
import inspect
import re
from pathlib import Path

import kneejax
from kneejax.cli._main import line

ROOT = Path(__file__).resolve().parents[1]
#: Word or phrase -> what the field, or plain English, has in its place.
BANNED = {
    "anew": "again",
    "in vain": "failed",
    "all the same": "nevertheless, or nothing",
    "once more": "again",
    "besides(?! muscles)": "as well, in addition to",  # a name in residual.csv
    "by way of": "through, along",
    "told": "reported, determined",
    "said to": "reported as",
    "likeliest": "maximum-likelihood",
    "what is none": "what is not one",
    "that there is not": "that does not exist",
    "(?:make|makes|made|making) up for": "compensate",
    "this field left out": "omit this field",
    "data (?:can )?tell": "data determine",
    "not a matter of": "not explained by",
    "falls? back from": "is undone by",
    "a program of one whole body": "a whole-body simulation",
    "turned? round": "reverse",
    "otherwise called": "under another name",
    "hop|hops": "off-grid step",
    "astray": "off-branch",
}
PATTERN = re.compile(rf"\b(?:{'|'.join(BANNED)})\b", re.IGNORECASE)


def sentences():
    """Place -> text: pages of the documentation, prose, messages, help, public docstrings."""
    pages = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("kneejax/**/*.toml")]
    for path in sorted([*pages, *ROOT.glob("kneejax/**/*.j2")]):
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            yield f"{path.relative_to(ROOT)}:{number}", text
    for path in sorted((ROOT / "kneejax").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        own = {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
        for node in ast.walk(tree):
            words = isinstance(node, ast.Constant) and isinstance(node.value, str)
            if words and id(node) not in own:
                yield f"{path.relative_to(ROOT)}:{node.lineno}", node.value
    for name in kneejax.__all__:
        yield f"kneejax.{name}", inspect.getdoc(getattr(kneejax, name)) or ""
    for command, model in line().commands.items():
        yield f"kneejax {command} --help", inspect.getdoc(model) or ""


def test_words_that_may_not_come_back():
    found = [
        f"{place}: {match[0]!r} ({text.strip()[:90]})"
        for place, text in sentences()
        for match in PATTERN.finditer(text)
    ]
    assert not found, "\n".join(found)
