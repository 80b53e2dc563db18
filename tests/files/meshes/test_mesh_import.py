"""Meshes of known shapes become those shapes; meshes that are no knee are refused."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.files import InputProblem, MeshOptions, import_meshes
from kneejax.files.knee.document import mirror_part
from kneejax.files.knee.surfaces import build_surface
from kneejax.files.meshes.importing import find_bones, right_sheets
from kneejax.files.meshes.surfaces import fit_patella
from kneejax.geometry import Frame
from kneejax.report import surface_fit_figure
from tests.files.meshes import meshed_knee as made

LENHART = Path(__file__).parents[3] / "../shared/data/lenhart2015/meshes"
QUICK = {"cell_mm": 6.0, "smoothing_mm": 0.3}


def imported(*meshes, side, **options):
    return import_meshes(*meshes, side=side, options=MeshOptions(**options))


def files(folder, femur=None, tibia=None, scale=1.0):
    femur = made.femoral() if femur is None else femur
    tibia = made.tibial() if tibia is None else tibia
    return (
        made.written(folder / "femur.stl", femur, scale),
        made.written(folder / "tibia.stl", tibia, scale),
    )


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_plate_under_both_condyles_is_two_compartments_and_one_under_one_is_one(side, tmp_path):
    def insert(low, high):
        def place(z, x):
            near = np.minimum(*((z - made.CENTRES[name]) ** 2 for name in made.CENTRES))
            return x, -24.0 + 0.006 * x * x + 0.008 * near, z

        return made.sheet(place, (low, high), (-17.0, 18.0), (50, 30))

    findings, parts = [], {}
    for name, ends in (("both", (-36.0, 37.0)), ("medial", (-36.0, 4.0))):
        meshes = [made.femoral(), insert(*ends)]
        meshes = [made.mirrored(mesh) for mesh in meshes] if side == "left" else meshes
        read = (
            right_sheets(path, "auto", side == "left", findings)
            for path in files(tmp_path, *meshes)
        )
        _, parts[name] = find_bones(*read, MeshOptions(), side == "left", findings)
    assert list(parts["both"]) == ["medial", "lateral"] and list(parts["medial"]) == ["medial"]
    areas = {name: sheet.face_areas.sum() for name, sheet in parts["both"].items()}
    assert areas["medial"] == pytest.approx(areas["lateral"], rel=0.1)
    assert sum("one sheet, parted at z = " in finding for finding in findings) == 1
    assert any("it lies under both condyles" in finding for finding in findings)


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    folder = tmp_path_factory.mktemp("right")
    bones = {
        "femur_bone": made.written(folder / "femur_bone.stl", made.femoral(inwards=2.0)),
        "tibia_bone": made.written(folder / "tibia_bone.stl", made.tibial(down=3.0)),
    }
    return imported(*files(folder), side="r", **bones)


@pytest.mark.long
def test_both_compartments_are_found_with_their_shapes(right):
    assert list(right.contacts) == ["medial", "lateral"] and not right.doubtful
    for name, contact in right.contacts.items():
        condyle = build_surface(contact["femoral_surface"])
        plateau = build_surface(contact["tibial_surface"])
        across = made.CENTRES[name] + np.arange(-8.0, 9, 4)
        angle, z = np.meshgrid(np.deg2rad(np.arange(60.0, 200, 10)), across)
        r = made.condyle_radius(name, angle, z)
        point = r * np.cos(angle), -r * np.sin(angle), z
        level = condyle.level(condyle.frame.placement.apply_inverse(tuple(map(jnp.asarray, point))))
        # A mesh of 1.5 mm flattens a radius of 23 mm by 0.012 mm between its corners.
        assert np.abs(level).max() < 0.02
        x, z = np.meshgrid(np.arange(-14.0, 15, 4), across)
        point = x, made.plateau_height(name, x, z), z
        level = plateau.level(plateau.frame.placement.apply_inverse(tuple(map(jnp.asarray, point))))
        assert np.abs(level).max() < 0.02


def test_what_is_left_over_is_said(right):
    for name, fit in right.fits.items():
        assert fit.quality.rms < 0.01 and abs(fit.quality.mean) < 1e-3, name
        assert fit.quality.patch_maximum < 0.02
        assert any(line.startswith(f"{name}: ") and "held out" in line for line in right.findings)
    assert any("transverse axis" in line for line in right.findings)


def test_the_layer_is_measured_along_the_normals(right):
    for contact in right.contacts.values():
        # Femoral 2 mm along rays, which lean against the normal by some degrees; tibial 3 mm.
        assert contact["layer_thickness_mm"] == pytest.approx(5.0, abs=0.08)
        assert "layer_variation_mm" not in contact


def test_an_outline_is_the_border_of_the_sheet(right):
    outline = np.array(right.contacts["medial"]["tibial_surface"]["outline_mm"])
    a, b = outline, np.roll(outline, -1, axis=0)
    area = 0.5 * abs(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    assert area == pytest.approx(22 * 35, rel=0.03)


def test_a_left_knee_is_the_mirrored_twin(right, tmp_path):
    left = files(tmp_path, made.mirrored(made.femoral()), made.mirrored(made.tibial()))
    bones = {
        "femur_bone": made.written(tmp_path / "a.stl", made.mirrored(made.femoral(inwards=2.0))),
        "tibia_bone": made.written(tmp_path / "b.stl", made.mirrored(made.tibial(down=3.0))),
    }
    found = imported(*left, side="l", source="femur.stl, tibia.stl", **bones)
    assert list(found.contacts) == list(right.contacts)
    for name, contact in found.contacts.items():
        twin, expected = mirror_part(contact), right.contacts[name]
        for part in ("femoral_surface", "tibial_surface"):
            for field, value in expected[part].items():
                if isinstance(value, str):
                    assert twin[part][field] == value
                else:
                    np.testing.assert_allclose(twin[part][field], value, rtol=0, atol=1e-9)


def test_metres_and_flipped_normals_are_repaired(right, tmp_path):
    points, faces = made.femoral()
    found = imported(*files(tmp_path, (points, faces[:, ::-1]), scale=1e-3), side="r", **QUICK)
    text = " ".join(found.findings)
    assert "multiplied by 1000" in text and "normals faced the bone" in text
    for name, fit in found.fits.items():
        assert fit.quality.rms < 0.02, name
    assert found.contacts["medial"]["layer_thickness_mm"] == 6.0
    assert "No bone meshes" in text


def test_a_bone_behind_the_cartilage_in_one_file_is_left_out(tmp_path):
    both = made.joined(made.femoral(), made.femoral(inwards=2.5))
    found = imported(*files(tmp_path, both), side="r", **QUICK)
    assert any("a second sheet behind the first" in line for line in found.findings)
    surface = build_surface(found.contacts["lateral"]["femoral_surface"])
    here = (0.0, -made.condyle_radius("lateral", np.pi / 2, 22.0), 22.0)
    local = surface.frame.placement.apply_inverse(tuple(map(jnp.asarray, here)))
    assert abs(float(surface.level(local))) < 0.03


def test_an_axis_that_leans_is_found(right, tmp_path):
    turn = Frame([3.0, -2.0, 0.0], np.deg2rad([4.0, -6.0, 0.0])).placement

    def moved(part):
        points = np.stack([np.asarray(c) for c in turn.apply(tuple(part[0].T))], axis=1)
        return points, part[1]

    found = imported(*files(tmp_path, moved(made.femoral()), moved(made.tibial())),
                          side="r", **QUICK)  # fmt: skip
    surface = found.contacts["medial"]["femoral_surface"]
    # One condyle is larger, so even the straight knee's nearest cylinder leans.
    straight = np.array(right.contacts["medial"]["femoral_surface"]["axis_rotation_deg"])
    expected = straight + [4.0, -6.0, 0.0]
    np.testing.assert_allclose(surface["axis_rotation_deg"], expected, atol=0.5)
    for name, fit in found.fits.items():
        assert fit.quality.rms < 0.03, name


def patella_at(surface, y, z):
    """How far outside a fitted patella its cartilage lies."""
    point = made.patella_depth(y, z), y, z
    return surface.level(surface.frame.placement.apply_inverse(tuple(map(jnp.asarray, point))))


def test_a_patella_is_fitted_and_kept(tmp_path):
    """Or turned, with its bone behind it, and left: the mirrored twin."""
    grid = np.meshgrid(np.arange(-11.0, 14, 4), np.arange(-18.0, 20, 4))
    femur, tibia = files(tmp_path)
    sheet = made.written(tmp_path / "patella.ply", made.patellar())
    right = imported(femur, tibia, patellar_cartilage=sheet, side="r", **QUICK)
    assert right.fits["patella"].region.all() and not right.doubtful
    assert any(line.startswith("patella: ") for line in right.findings)
    surface = right.patellofemoral["patellar_surface"]
    # Corners between which a ridge of radius 5 mm is flattened by 0.04 mm.
    assert np.abs(patella_at(build_surface(surface), *grid)).max() < 0.08
    drawn = surface_fit_figure({name: part.fit for name, part in right.fits.items()}).axes
    words = [axes.get_ylabel() for axes in drawn if axes.get_xlabel() == "lateral, mm"]
    assert words == ["anterior, mm", "anterior, mm", "superior, mm"]

    both = made.joined(made.patellar(), made.patellar(forwards=3.0))
    turned = both[0], both[1][:, ::-1]
    left = imported(
        *files(tmp_path, made.mirrored(made.femoral()), made.mirrored(made.tibial())), side="l",
        patellar_cartilage=made.written(tmp_path / "left.ply", made.mirrored(turned)), **QUICK,
    )  # fmt: skip
    words = " ".join(left.findings)
    assert "normals faced the bone" in words and "a second sheet behind the first" in words
    twin = mirror_part(left.patellofemoral["patellar_surface"])
    for field, value in surface.items():
        if not isinstance(value, str):
            np.testing.assert_allclose(twin[field], value, rtol=0, atol=1e-9, err_msg=field)


def refusal(folder, *parts, **options):
    with pytest.raises(InputProblem) as caught:
        imported(*files(folder, *parts), side=options.pop("side", "r"), **options, **QUICK)
    line = str(caught.value)
    assert "\n" not in line and "expected " in line
    return line


def shifted(part, by):
    return part[0] + np.asarray(by, float), part[1]


def test_meshes_that_do_not_meet_are_refused(tmp_path):
    far = shifted(made.tibial(), [0.0, -90.0, 0.0])
    assert "frames differ" in refusal(tmp_path, None, far)
    above = shifted(made.tibial(), [0.0, 60.0, 0.0])
    assert "above the axis" in refusal(tmp_path, None, above)
    beside = shifted(made.tibial(), [0.0, 0.0, 45.0])
    assert "side of the notch" in refusal(tmp_path, None, beside)
    one = made.condyle("medial")
    assert "wide" in refusal(tmp_path, one)


def test_meshes_that_are_no_patella_are_refused(tmp_path):
    def written(points, faces):
        return made.written(tmp_path / "patella.ply", (points, faces))

    def alone(points, faces):
        with pytest.raises(InputProblem, match="^[^\n]*expected [^\n]*$") as caught:
            fit_patella(right_sheets(written(points, faces), "auto", False, []), [], QUICK)
        return str(caught.value)

    points, faces = made.patellar()
    lying = points[:, [1, 0, 2]]
    assert "faces backwards" in refusal(tmp_path, patellar_cartilage=written(lying, faces))
    assert "faces backwards" in alone(lying, faces)
    assert "is the unit right?" in alone(points * 4.0, faces)
    assert "wide" in alone(points * 0.2, faces)
    apart = made.joined((points * 0.4, faces), (points * 0.4 + [0.0, 0.0, 40.0], faces))
    assert "one sheet" in alone(*apart)


def test_cartilage_below_its_bone_is_refused(tmp_path):
    bones = {
        "femur_bone": made.written(tmp_path / "a.stl", made.femoral(inwards=-1.5)),
        "tibia_bone": made.written(tmp_path / "b.stl", made.tibial(down=3.0)),
    }
    assert "thicker than zero" in refusal(tmp_path, **bones)


def test_a_field_of_thickness(tmp_path):
    def thinning(part):
        points = part[0].copy()
        points[:, 1] -= 0.03 * points[:, 0]  # 3 mm in the middle, thicker in front
        return points, part[1]

    bones = {
        "femur_bone": made.written(tmp_path / "a.stl", made.femoral(inwards=2.0)),
        "tibia_bone": made.written(tmp_path / "b.stl", thinning(made.tibial(down=3.0))),
    }
    found = imported(*files(tmp_path), side="r", thickness="field", **bones, **QUICK)
    contact = found.contacts["medial"]
    table = np.array(contact["layer_variation_mm"])
    half = 0.5 * np.ptp(contact["tibial_surface"]["anterior_mm"])
    s = np.linspace(-0.7, 0.7, 8)
    field = np.polynomial.polynomial.polyval2d(s, 0 * s, table)
    np.testing.assert_allclose(np.diff(field), 0.03 * half * np.diff(s), atol=0.03)
    assert "for a field" in refusal(tmp_path, thickness="field")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"side": "medial"}, "right or left"),
        ({"law": "cubic"}, "one of linear"),
        ({"thickness": "fields"}, "one of constant"),
        ({"layer_thickness_mm": 0.0}, "between 0.1 and 50 mm"),
        ({"unit": "inch"}, "one of auto"),
    ],
)
def test_bad_choices_are_refused(tmp_path, options, words):
    assert words in refusal(tmp_path, **options)


@pytest.mark.skipif(not LENHART.is_dir(), reason="the public meshes are not here")
def test_a_real_knee_is_met_within_the_target():
    names = (LENHART / f"lenhart2015-R-{bone}-cartilage.stl" for bone in ("femur", "tibia"))
    found = imported(*names, side="r", cell_mm=4.5, smoothing_mm=0.2)
    assert list(found.contacts) == ["medial", "lateral"] and not found.doubtful
    for name, fit in found.fits.items():
        assert fit.quality.rms < 0.1 and abs(fit.quality.mean) < 2e-3, name


@pytest.mark.skipif(not LENHART.is_dir(), reason="the public meshes are not here")
def test_a_real_patella_is_met_within_the_target():
    sheets = right_sheets(LENHART / "lenhart2015-R-patella-cartilage.stl", "auto", False, [])
    fit = fit_patella(sheets, [], {})
    assert fit.rms < 0.1  # mm, all of it; found: 0.083
