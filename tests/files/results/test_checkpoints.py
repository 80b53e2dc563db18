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


def damaged(path, mode):
    """Damage a file as disks and people do."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    half = data[: len(data) // 2]
    path.write_bytes({"flip": data, "half": half, "empty": b"", "text": b"not a cache"}[mode])


@pytest.mark.parametrize("mode", ["flip", "half", "empty", "text"])
def test_what_was_damaged_is_missing_and_mended(tmp_path, mode):
    """Once a part that was cut was a traceback, and a claim that was cut had no way out."""
    for path in ("parts/first.part", "study.json"):
        Checkpoints(tmp_path, ABOUT, b"data").save("first", {"a": np.arange(3)})
        Checkpoints(tmp_path, ABOUT, b"data").save("second", {"a": np.arange(4)})
        damaged(tmp_path / path, mode)
        store = Checkpoints(tmp_path, ABOUT, b"data")
        assert (store.load("first") is None) == path.startswith("parts")
        assert store.load("second")["a"].tolist() == [0, 1, 2, 3]
        store.save("first", {"a": np.arange(3)})
        mended = Checkpoints(tmp_path, ABOUT, b"data")
        assert mended.load("first")["a"].tolist() == [0, 1, 2]


def test_a_part_of_other_work_is_none_of_this(tmp_path):
    Checkpoints(tmp_path, ABOUT, b"data").save("first", {"a": np.zeros(1)})
    (tmp_path / "study.json").unlink()
    assert Checkpoints(tmp_path, ABOUT, b"other").load("first") is None


def test_who_was_there_before_is_asked_to_go_once(tmp_path):
    begun = []
    store = Checkpoints(tmp_path, ABOUT, b"data", begin=lambda: begun.append(1))
    assert not begun
    for name in ("first", "second"):
        store.save(name, {"a": np.zeros(1)})
    Checkpoints(tmp_path, ABOUT, b"data", begin=lambda: begun.append(2)).save("third", {})
    assert begun == [1]
