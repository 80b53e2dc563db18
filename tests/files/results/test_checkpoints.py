"""Finished parts of long work survive, and never serve other work."""

import numpy as np
import pytest

from kneejax.files import Checkpoints, InputProblem

ABOUT = {"study": "a test", "grid": "4x4"}


def test_parts_come_back_bit_by_bit(tmp_path):
    arrays = {"a": np.array([0.1, np.nan]), "b": np.arange(3, dtype=np.int8)}
    Checkpoints(tmp_path / "out", ABOUT, b"data").save("first", arrays)
    again = Checkpoints(tmp_path / "out", ABOUT, b"data")
    found = again.load("first")
    assert again.resumed == 1 and again.load("second") is None
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


def test_nothing_is_written_before_the_first_part(tmp_path):
    Checkpoints(tmp_path / "out", ABOUT, b"data")
    assert not (tmp_path / "out").exists()


def test_done_leaves_the_claim_alone(tmp_path):
    store = Checkpoints(tmp_path, ABOUT, b"data")
    store.save("first", {"a": np.zeros(1)})
    store.done()
    assert [path.name for path in tmp_path.iterdir()] == ["study.json"]
    assert Checkpoints(tmp_path, ABOUT, b"data").load("first") is None


@pytest.mark.parametrize(
    ("about", "data", "words"),
    [
        ({**ABOUT, "grid": "9x9"}, b"other", "its grid is 4x4, not 9x9"),
        (ABOUT, b"other", "it was made from other data"),
    ],
)
def test_a_folder_of_other_work_is_refused(tmp_path, about, data, words):
    Checkpoints(tmp_path, ABOUT, b"data").save("first", {"a": np.zeros(1)})
    with pytest.raises(InputProblem, match=words):
        Checkpoints(tmp_path, about, data)


def test_a_claim_that_is_no_json_is_refused(tmp_path):
    (tmp_path / "study.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputProblem, match="JSON"):
        Checkpoints(tmp_path, ABOUT, b"data")
