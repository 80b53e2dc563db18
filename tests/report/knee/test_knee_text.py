"""A knee in words says what its file holds, briefly where there are many fibres."""

import re

import numpy as np
import pytest

from kneejax import report
from kneejax.files import bundled_knees, load_knee_file
from kneejax.parameters import select


@pytest.fixture(scope="module")
def full():
    return load_knee_file("lenhart2015")


def rows(text, section):
    """Words of the lines of a section's table, by their first."""
    part = text.split(section, 1)[1].split("\n\n", 1)[0].split("  groups:")[0]
    return {words[0]: words[1:] for line in part.splitlines()[1:] if (words := line.split())}


def test_many_fibres_are_gathered_and_nothing_is_lost(full):
    text = report.knee_text(full.knee, full.document)
    table = rows(text, "Ligaments: 55 fibres")
    bundles = {name: row for name, row in table.items() if len(row) > 2 and row[0].isdigit()}
    assert sum(int(row[0]) for row in bundles.values()) == 55
    stiffness = sum(float(row[1]) for row in bundles.values())
    assert stiffness == pytest.approx(float(np.sum(full.knee.ligaments.stiffness)))
    assert "ACL = ACLpl + ACLam" in text
    assert "around Med_LigP_r (4 of 5)" in text
    assert all(len(line) < 100 for line in text.splitlines())


def test_layer_form_points_and_fits_are_said(full):
    text = report.knee_text(full.knee, full.document)
    for name, part in full.document["contacts"].items():
        m, n = part["points"]
        assert f"Contact {name}: quadrature over {m} x {n} points, linear law" in text
        assert f"layer {part['layer_thickness_mm']:g} mm" in text
        assert f"{part['tibial_surface']['fit_rms_mm']:.3f} mm rms" in text
    assert "ellipsoid on the tibia, semi-axes 30 x 18 x 12 mm, for 11 fibres" in text
    assert " ".join(full.document["notes"].split()[:6]) in " ".join(text.split())


@pytest.mark.parametrize("name", bundled_knees())
def test_stiffnesses_are_those_that_parameters_have(name):
    """Of fibres, of bundles and of structures: what is printed may be given."""
    file = load_knee_file(name)
    text = report.knee_text(file.knee, file.document)
    section = text.split("\nLigaments: ", 1)[1].split("\n\n", 1)[0]
    table, *groups = section.split("\n  groups: ")
    head, *lines = [line.split() for line in table.splitlines()[1:]]
    parts = {*file.knee.ligaments.names, *dict(file.knee.groups)}
    column = head.index("stiffness_N")
    printed = {words[0]: float(words[column]) for words in lines if words[0] in parts}
    for one in " ".join(groups).split("\n  By a")[0].split(";"):
        group, _, rest = " ".join(one.split()).partition(" = ")
        printed |= {group: float(rest.split(", ")[-1].removesuffix(" N"))} if rest else {}
    assert printed.keys() >= dict(file.knee.groups).keys()
    for part, stiffness in printed.items():
        found = float(select(file.knee, [f"{part}.stiffness"]).read(file.knee)[0])
        assert stiffness == float(f"{found:.0f}"), part


def test_few_fibres_have_a_row_each_with_their_strain():
    file = load_knee_file("four_ligament")
    table = rows(report.knee_text(file.knee, file.document), "Ligaments: 4 fibres")
    for i, name in enumerate(file.knee.ligaments.names):
        stiffness, length, slack, strain = (float(x) for x in table[name])
        assert stiffness == float(file.knee.ligaments.stiffness[i])
        assert length / slack - 1.0 == pytest.approx(strain, abs=1e-4)
        assert strain == pytest.approx(float(file.knee.reference_strain()[i]), abs=1e-4)


def test_every_fibre_can_be_asked_for_also_around_obstacles(full):
    """The model's author set slack lengths by strains of whole percents in extension."""
    text = report.knee_text(full.knee, full.document, every_fibre=True)
    found = rows(text, "Ligaments: 55 fibres")
    for name in full.knee.ligaments.names:
        _, length, slack, strain = (float(x) for x in found[name][:4])
        assert length / slack - 1.0 == pytest.approx(strain, abs=1e-4)
        assert strain == pytest.approx(round(strain, 2), abs=2e-4), name


@pytest.mark.parametrize("name", sorted(bundled_knees()))
def test_no_bundled_knee_contradicts_itself(name):
    """Fibres, menisci and patella: what the prose says is what the tables have."""
    document = load_knee_file(name).document
    adapted = [str(change) for change in document.get("adaptations", ())]
    prose = " ".join([document["description"], document.get("notes", ""), *adapted]).split()
    prose = " ".join(prose).lower()
    has_menisci = any("menisc" in contact for contact in document["contacts"])
    assert not (has_menisci and "no menisci" in prose)
    assert not ("patella" in document and ("no patella" in prose or "not patella" in prose))
    total = re.search(r"all (\d+) (?:\w+ )*fibres", prose)
    assert total is None or int(total[1]) == len(document["ligaments"])
