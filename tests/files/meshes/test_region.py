"""Where cartilages can touch: a drum on a flat plate, of which all is known."""

import numpy as np

import kneejax.geometry as geo
from kneejax.files.meshes.anatomy import Cloud, Femur
from kneejax.files.meshes.surfaces import FLEXIONS_DEG, NEAR_MM, SLIDES_MM, contact_regions

RADIUS_MM = 20.0
#: From the place where drum and plate touch, the plate leaves the drum by `NEAR_MM` here.
REACH_MM = np.sqrt((RADIUS_MM + NEAR_MM) ** 2 - RADIUS_MM**2)
#: A cell of the region and its neighbour.
CELLS_DEG = 6.0


def regions(radius_mm, least_x_mm=-30.0, least_deg=10.0):
    """Degrees around the drum with its mask, and places along the plate with theirs."""
    degrees, z = (g.ravel() for g in np.meshgrid(np.arange(20.0, 300.0), np.arange(-6.0, 7.0, 2.0)))
    around = np.deg2rad(degrees)
    drum = geo.Condyle(radius_mm, np.deg2rad([least_deg, 310.0]), (-10.0, 10.0))
    points = np.c_[RADIUS_MM * np.cos(around), -RADIUS_MM * np.sin(around), z]
    along = np.arange(least_x_mm, 31.0)
    x, across = (g.ravel() for g in np.meshgrid(along, np.arange(-6.0, 7.0, 2.0)))
    plate = np.c_[x, np.full_like(x, -RADIUS_MM), across]
    one = np.ones(len(points))
    femur = Femur(Cloud(points, one, points / RADIUS_MM), geo.Frame(), 0.0)
    mask, touched = contact_regions(femur, geo.SplineFit(drum, points, 0.0 * one, one), plate)
    return degrees, mask, x, touched


def test_a_plate_that_flexes_rolls_from_distal_to_posterior_and_slides():
    degrees, mask, x, touched = regions([[RADIUS_MM]])
    assert (touched == (np.abs(x) < REACH_MM + max(SLIDES_MM))).all()
    reach = np.rad2deg(np.arctan(REACH_MM / RADIUS_MM))
    first, last = 90.0 + FLEXIONS_DEG[0] - reach, 90.0 + FLEXIONS_DEG[-1] + reach
    assert mask[(degrees > first + 1.0) & (degrees < last - 1.0)].all()
    assert not mask[(degrees < first - CELLS_DEG) | (degrees > last + CELLS_DEG)].any()


def test_at_each_flexion_the_gap_counts_from_where_it_is_smallest():
    # The drum is 6 mm lower behind than before: it is touched there all the same.
    degrees, mask, *_ = regions([[RADIUS_MM], [-3.0]])
    assert mask[(degrees > 100.0) & (degrees < 230.0)].all()


def test_half_a_plate_reaches_further_by_its_edge_the_further_it_slides():
    # Its edge slides to 16 mm before the axis, and what is near there lies anterior of the middle.
    degrees, mask, *_ = regions([[RADIUS_MM]], least_x_mm=6.0)
    edge = 90.0 + FLEXIONS_DEG[0] - np.rad2deg(np.arctan((6.0 + max(SLIDES_MM)) / RADIUS_MM))
    assert mask[(degrees > edge) & (degrees < edge + 20.0)].all()


def test_what_one_flexion_leaves_beside_the_drum_another_touches():
    _, _, x, touched = regions([[RADIUS_MM]], least_deg=100.0)
    assert touched[np.abs(x) < REACH_MM + max(SLIDES_MM)].all()
