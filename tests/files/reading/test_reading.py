"""Text that is no file of the package is refused in one line, at once, whatever its size."""

import json
import time

import pytest

from kneejax.files import InputProblem, load_knee
from kneejax.files.reading import load_json, load_yaml, plain_number, read_text
from kneejax.quantities import nearest_name

#: Each line nine times the one before: 451 bytes that stand for 3.9e8 texts.
BOMB = "name0: &n0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"name{k}: &n{k} [{', '.join([f'*n{k - 1}'] * 9)}]\n" for k in range(1, 9)
)
YAML = {
    "a bomb": (BOMB, "line 6, column 8: aliases that stand for"),
    "an alias inside what it names": ("a: &b {c: *b}", "column 11: an alias inside what it names"),
    "aliases that nest": (
        "\n".join(["- &a0 [1]", *(f"- &a{k} [*a{k - 1}]" for k in range(1, 99))]), "too deep"
    ),
    "open brackets": ("[" * 20_000, "line 1, column 51: lists or mappings too deep"),
    "dashes": ("- " * 20_000, "lists or mappings too deep"),
    "a number of many digits": ("a: " + "9" * 5000, "column 4: a number of 5000 characters"),
    "a truth value that is none": ("a: !!bool x", "column 4: the tag tag:yaml.org,2002:bool"),
    "a date": ("a: !!timestamp x", "the tag tag:yaml.org,2002:timestamp of 'x'"),
    "a number that is none": ('a: !!float ""', "the tag tag:yaml.org,2002:float of ''"),
    "another tag": ("a: !!set {b}", "the tag tag:yaml.org,2002:set"),
    "a key that is a number": ("1: 2", "the key '1', which is not text"),
    "a key that is a list": ("[1]: 2", "the key a list or mapping, which is not text"),
    "a key twice": ("a: 1\na: 2", "line 2, column 1: the key a twice"),
}  # fmt: skip
JSON = {
    "a number of many digits": ('{"a": ' + "9" * 5000 + "}", "a number of 5000 digits"),
    "open brackets": ('{"a": ' + "[" * 20_000, "lists or mappings too deep in one another"),
    "a name twice": ('{"a": 1, "a": 2}', "the name 'a' twice"),
}


@pytest.mark.parametrize(("read", "text", "said"), [
    *(pytest.param(load_yaml, *one, id=f"YAML: {name}") for name, one in YAML.items()),
    *(pytest.param(load_json, *one, id=f"JSON: {name}") for name, one in JSON.items()),
])  # fmt: skip
def test_what_no_file_has_is_refused_at_once(tmp_path, read, text, said):
    path = tmp_path / "knee.yaml"
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises(InputProblem) as problem:
        read(path, "a knee file")
    assert time.process_time() - begin < 1.0
    assert said in str(problem.value) and str(path) in str(problem.value)


def test_aliases_stand_for_what_they_name(tmp_path):
    path = tmp_path / "knee.yaml"
    path.write_text("a: &point [1, 2.5, text]\nb: *point\nc: !!str 5\nd: !!float 5\n")
    document = load_yaml(path, "a knee file")
    assert document == {"a": [1, 2.5, "text"], "b": [1, 2.5, "text"], "c": "5", "d": 5.0}


def test_a_value_is_cut_before_it_is_written_out():
    whole = ["lol"] * 9
    for _ in range(60):  # 9 to the 61st texts
        whole = [whole] * 9
    said = str(InputProblem("knee.yaml", "name", whole, "a text"))
    assert said.startswith("knee.yaml: name: [[[[") and said.endswith("...: expected a text")
    assert "about 5000 digits" in str(InputProblem("k", "f", 10**5000, "a number"))
    assert str(InputProblem("k", "f", {"a": (1,), "b": b"x"}, "y")) == (
        "k: f: {'a': (1,), 'b': b'x'}: expected y"
    )
    assert len(str(InputProblem("k", "f" * 10**6, "v" * 10**7, "e" * 10**6, ["n"]))) < 2000


@pytest.mark.parametrize(
    "text", ["1_000", "١٢", "１２", "0x10", "1e5_0", "--1", "+nan-", "", "1 2"]
)
def test_what_only_python_takes_for_a_number_is_none(text):
    assert plain_number(text) is None


@pytest.mark.parametrize(
    "word",
    ["posterior_mm", "medial_N", "inferior_mm", "distraction_N", "valgus_Nm", "abduction_deg",
     "external_rotation_deg", "extension_deg"],
)  # fmt: skip
def test_no_name_of_the_opposite_sense_is_suggested(word):
    known = ["anterior_mm", "lateral_N", "superior_mm", "compression_N", "varus_Nm",
             "adduction_deg", "internal_rotation_deg", "flexion_deg"]  # fmt: skip
    assert nearest_name(word, known) is None


@pytest.mark.parametrize("between", [False, True])
def test_a_result_that_leads_back_to_itself_is_refused(tmp_path, between):
    one, other = tmp_path / "one.json", tmp_path / "other.json"
    for path, knee in ((one, other if between else one), (other, one)):
        path.write_text(json.dumps({"parameters": {}, "knee": str(knee)}))
    with pytest.raises(InputProblem, match=r"one.json: knee: .*lead back to themselves"):
        load_knee(one)


def test_a_correlation_without_its_matrix_is_refused(tmp_path):
    path = tmp_path / "result.json"
    found = {"parameters": {}, "knee": "four_ligament", "correlation": {"parameters": []}}
    path.write_text(json.dumps(found))
    with pytest.raises(InputProblem, match=r"correlation.matrix: missing: expected this field"):
        load_knee(path)


def test_a_name_that_is_too_long_for_a_file_is_told_as_such(tmp_path):
    """A force file of a thousand letters, named in external loads, once ended in a traceback."""
    with pytest.raises(InputProblem, match="long"):
        read_text(tmp_path / ("a" * 1000), "a table")
