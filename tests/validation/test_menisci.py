"""A knee with menisci and after meniscectomy, beside what was measured in human knees."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj


@pytest.fixture(scope="module")
def menisci(benchmark_script):
    return benchmark_script("menisci")


@pytest.fixture(scope="module")
def knee(menisci):
    return menisci.knee_with_menisci()


@pytest.fixture(scope="module")
def whole(menisci, knee):
    return menisci.pressed(knee)


@pytest.fixture(scope="module")
def without(menisci, knee):
    return menisci.pressed(kj.cut(knee, menisci.removed()))


@pytest.mark.long
def test_menisci_carry_half_of_the_load_or_more(whole):
    """At least 45 % (Shrive et al. 1978); medially about half (Walker and Erkman 1975)."""
    assert 0.45 < np.mean([x.share for x in whole.values()]) < 0.75
    assert 0.4 < whole["medial"].share < 0.7


@pytest.mark.long
def test_without_menisci_less_area_and_more_pressure(whole, without):
    """1150 and 520 mm^2, 3 and 6 MPa at 1000 N (Fukubayashi and Kurosawa 1980); 75 % less area
    (Baratz et al. 1986)."""
    area, left = (sum(x.area_mm2 for x in own.values()) for own in (whole, without))
    assert 900.0 < area < 1400.0 and 0.25 < left / area < 0.5
    peak, higher = (max(x.peak_MPa for x in own.values()) for own in (whole, without))
    assert 2.5 < peak < 4.5 and 1.5 < higher / peak < 3.0
    assert 1.5 < without["medial"].peak_MPa / whole["medial"].peak_MPa < 3.0


@pytest.mark.long
@pytest.mark.parametrize("part", [":inner=0.4", ":posterior=0.4", ":inner=0.5,anterior=0.6"])
def test_a_partial_meniscectomy_lies_between(menisci, knee, whole, without, part):
    found = menisci.pressed(kj.cut(knee, menisci.removed(part)))
    for name, own in found.items():
        assert without[name].share == 0.0 < own.share < whole[name].share
        assert without[name].area_mm2 < own.area_mm2 < whole[name].area_mm2
        assert without[name].peak_MPa > own.peak_MPa > whole[name].peak_MPa


@pytest.mark.long
def test_a_meniscus_carries_less_with_a_softer_hoop_and_least_without(menisci, whole):
    found = [menisci.pressed(menisci.knee_with_menisci(modulus)) for modulus in (30.0, 3.0, 1e-3)]
    for name in menisci.COMPARTMENTS:
        share = [own[name].share for own in (whole, *found)]
        moved = [own[name].extrusion_mm for own in (whole, *found)]
        assert (np.diff(share) < 0.0).all() and (np.diff(moved) > 0.0).all()


@pytest.mark.long
def test_a_meniscus_that_was_removed_is_none(menisci, knee):
    """As a knee file without that contact, and the other compartment as before."""
    keep = [row for row, name in enumerate(knee.contact_names) if name != "medial_meniscus"]
    fewer = dataclasses.replace(
        knee, contacts=tuple(knee.contacts[row] for row in keep),
        contact_names=tuple(knee.contact_names[row] for row in keep),
    )  # fmt: skip
    poses = kj.Pose.from_table([[0.0, 1.0, -2.0, 1.0, 0.2, 0.0], [20.0, 0.0, 3.0, 2.0, 0.4, 1.0]])
    found = kj.evaluate(kj.cut(knee, ["medial_meniscus"]), poses)
    as_file = kj.evaluate(fewer, poses)
    for name in ("contact_force", "area", "max_pressure", "mean_pressure", "max_depth", "too_deep",
                 "through_bone", "max_extrusion", "mean_extrusion", "tension"):  # fmt: skip
        one, other = (np.asarray(getattr(x, name)) for x in (found, as_file))
        one = one[:, keep] if name != "tension" else one
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9, err_msg=name)
    gone = knee.contact_names.index("medial_meniscus")
    for name in ("contact_force", "area", "max_pressure", "mean_pressure", "max_depth"):
        assert not np.asarray(getattr(found, name))[:, gone].any()
