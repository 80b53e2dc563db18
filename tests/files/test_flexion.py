"""Flexion angles as people write them."""

import pytest

from kneejax.files import InputProblem, parse_flexion


def test_flexion_texts():
    assert parse_flexion("0,30,60").tolist() == [0, 30, 60]
    assert parse_flexion("120:0:-40").tolist() == [120, 80, 40, 0]
    assert len(parse_flexion("0:0.3:0.1")) == 4
    ranges = ("a:b:c", "0:10:0", "0:10:-1", "0:10:nan", "0:400:5", "0:9:1e-9", "0:10")
    for text in (*ranges, "", "nan", "1,,2"):
        with pytest.raises(InputProblem, match="^--flexion: flexion_deg: .*expected"):
            parse_flexion(text)
