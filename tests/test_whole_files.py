"""Files are complete or absent, and damage to what is kept is noticed."""

import json
import os

import pytest

from kneejax._whole_files import (
    DRAFT,
    gathering,
    read_json,
    read_sealed,
    undamaged,
    with_checksum,
    write_checked,
    write_sealed,
    write_whole,
    written_place,
)
from kneejax.files import InputProblem, write_text

#: Ways in which files have been damaged: bits flipped, cut, emptied, replaced.
DAMAGE = {
    "half": lambda data: data[: len(data) // 2],
    "empty": lambda data: b"",
    "text": lambda data: b"not a cache",
}


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_what_ends_a_writing_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, error):
    path = tmp_path / "result.json"
    write_whole(path, b"old")

    def full(_):
        raise error

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises((OSError, KeyboardInterrupt)) as ended:
        write_whole(path, b"new")
    assert isinstance(ended.value, KeyboardInterrupt) or ended.value.filename == os.fspath(path)
    assert [*tmp_path.iterdir()] == [path] and path.read_bytes() == b"old"


def test_a_full_disk_names_the_file(tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputProblem, match=r"poses\.csv: file: No space left on device"):
        write_text(tmp_path / "poses.csv", "1")


def test_a_flipped_bit_is_noticed(tmp_path):
    path = tmp_path / "one.part"
    write_sealed(path, b"numbers of a map", "key")
    whole = path.read_bytes()
    assert read_sealed(path, "key") == b"numbers of a map"
    assert read_sealed(path, "another") is None and read_sealed(tmp_path / "none", "key") is None
    for place in range(0, len(whole), 4):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        path.write_bytes(damaged)
        assert read_sealed(path, "key") is None
    for damage in DAMAGE.values():
        path.write_bytes(damage(whole))
        assert read_sealed(path, "key") is None


def test_a_document_that_was_damaged_is_none(tmp_path):
    path, document = tmp_path / "task.json", {"task": "a", "files": {"b": 1.5}, "failed": ""}
    write_checked(path, document)
    assert undamaged(read_json(path)) == document
    path.write_text(path.read_text().replace("1.5", "1.6"))
    assert undamaged(read_json(path)) is None
    for text in ("", "{", "[]", "null", '{"task": "a"}', "[" * 20_000, "\xff"):
        path.write_bytes(text.encode("latin-1"))
        assert undamaged(read_json(path)) is None
    assert undamaged(json.loads(json.dumps(with_checksum(document)))) == document


def test_files_of_a_folder_are_gathered_and_read_again(tmp_path):
    draft, seen = tmp_path / f"{DRAFT}x", []
    with gathering(tmp_path, draft, lambda name, writing: seen.append((str(name), writing))):
        write_whole(tmp_path / "figures" / "a.png", b"picture")
        write_sealed(tmp_path / "parts" / "one", b"part")
        write_whole(tmp_path.parent / "elsewhere.txt", b"1")
        assert written_place(tmp_path / "figures" / "a.png").read_bytes() == b"picture"
        assert not (tmp_path / "figures").exists()
    assert (draft / "figures" / "a.png").is_file() and (tmp_path / "parts" / "one").is_file()
    assert (tmp_path.parent / "elsewhere.txt").is_file() and seen == [("figures/a.png", True)]
