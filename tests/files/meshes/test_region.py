"""Where cartilages can touch: a drum on a flat plate, of which all is known."""

import numpy as np

import kneejax.geometry as geo
from kneejax.files.meshes._anatomy import Cloud, Femur
from kneejax.files.meshes._region import FLEXIONS_DEG, NEAR_MM, SLIDES_MM, contact_regions

RADIUS_MM = 20.0
#: From the place where drum and plate touch, the plate leaves the drum by `NEAR_MM` here.
REACH_MM = np.sqrt((RADIUS_MM + NEAR_MM) ** 2 - RADIUS_MM**2)
#: A cell of the region and its neighbour.
CELLS_DEG = 6.0


def test_a_plate_that_flexes_rolls_from_distal_to_posterior_and_slides():
    degrees, z = np.meshgrid(np.arange(20.0, 300.0), np.arange(-6.0, 7.0, 2.0))
    degrees, z = degrees.ravel(), z.ravel()
    around = np.deg2rad(degrees)
    drum = geo.Condyle([[RADIUS_MM]], np.deg2rad([10.0, 310.0]), (-10.0, 10.0))
    points = np.c_[RADIUS_MM * np.cos(around), -RADIUS_MM * np.sin(around), z]
    x, across = (g.ravel() for g in np.meshgrid(np.arange(-30.0, 31.0), np.arange(-6.0, 7.0, 2.0)))
    plate = np.c_[x, np.full_like(x, -RADIUS_MM), across]

    one = np.ones(len(points))
    femur = Femur(Cloud(points, one, points / RADIUS_MM), geo.Frame(), 0.0)
    fit = geo.SplineFit(drum, points, 0.0 * one, one)
    mask, touched = contact_regions(femur, fit, plate)

    assert (touched == (np.abs(x) < REACH_MM + max(SLIDES_MM))).all()
    reach = np.rad2deg(np.arctan(REACH_MM / RADIUS_MM))
    first, last = 90.0 + FLEXIONS_DEG[0] - reach, 90.0 + FLEXIONS_DEG[-1] + reach
    assert mask[(degrees > first + 1.0) & (degrees < last - 1.0)].all()
    assert not mask[(degrees < first - CELLS_DEG) | (degrees > last + CELLS_DEG)].any()
