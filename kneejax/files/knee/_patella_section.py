"""The patella's section of a knee document: found, laid among the others, taken out again."""

from __future__ import annotations

from typing import Any

from kneejax.files._bundled import bundled_path
from kneejax.files.knee._mirror import mirror_document
from kneejax.files.knee._schema import SAME_AS
from kneejax.files.reading import load_yaml

#: Before the names of the section's obstacles where they stand among those of the knee.
_PREFIX = "patella."


def with_own_section(document: dict[str, Any]) -> dict[str, Any]:
    """The document with the section itself where it says that it is the same as another knee's.

    Args:
        document: content of a knee file with a section `patella`, of either side.
    """
    same_as = document["patella"].get(SAME_AS)
    if same_as is None:
        return document
    whole = load_yaml(bundled_path("knees", same_as), "a knee file")
    own = whole if whole["side"] == document["side"] else mirror_document(whole)
    return document | {"patella": own["patella"]}


def merged(document: dict[str, Any]) -> dict[str, Any]:
    """A document of three bones: ligaments, contacts and obstacles of the section among the others.

    Lines of constant tension, which stand for the patella where there is none, are left out.

    Args:
        document: as `with_own_section` gives it.
    """
    section = document["patella"]
    wraps = {f"{_PREFIX}{name}": wrap for name, wrap in section.get("wraps", {}).items()}
    own = {
        name: part | ({"wrap": f"{_PREFIX}{part['wrap']}"} if "wrap" in part else {})
        for name, part in section["ligaments"].items()
    }
    return {name: part for name, part in document.items() if name != "lines"} | {
        "ligaments": document["ligaments"] | own,
        "contacts": document["contacts"] | section["contacts"],
        "wraps": document.get("wraps", {}) | wraps,
    }


def parted(whole: dict[str, Any], document: dict[str, Any]) -> dict[str, Any]:
    """What was merged, in its sections again.

    Args:
        whole: as `merged` makes it, perhaps with other numbers.
        document: of which it was made.
    """
    section = document["patella"]

    def own(name: str, inside: bool) -> dict[str, Any]:
        return {k: x for k, x in whole[name].items() if (k in section[name]) == inside}

    ligaments = {
        name: part | ({"wrap": part["wrap"].removeprefix(_PREFIX)} if "wrap" in part else {})
        for name, part in own("ligaments", True).items()
    }
    wraps: tuple[dict[str, Any], dict[str, Any]] = {}, {}
    for name, wrap in whole["wraps"].items():
        wraps[name.startswith(_PREFIX)][name.removeprefix(_PREFIX)] = wrap
    patella = section | {"ligaments": ligaments, "contacts": own("contacts", True)}
    found = document | {
        "ligaments": own("ligaments", False),
        "contacts": own("contacts", False),
        "patella": patella | ({"wraps": wraps[True]} if wraps[True] else {}),
    }
    return found | ({"wraps": wraps[False]} if wraps[False] else {})
