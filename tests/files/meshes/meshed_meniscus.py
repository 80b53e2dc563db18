"""A meniscus of known radii, horns and height as a mesh, on the plateau of a knee."""

import numpy as np

from kneejax.files import mirror_document
from kneejax.files.knee.surfaces import build_surface

INNER, OUTER, EDGE, HEIGHT = 7.0, 14.0, 0.6, 6.0
AREA = 0.5 * (OUTER - INNER) * (EDGE + HEIGHT)
#: Compartment of a right knee -> angles of the horns, degrees from the front towards the right.
HORNS = {"medial": (-225.0, 45.0), "lateral": (-50.0, 230.0)}
MIDDLE = {"medial": (0.5, 0.3), "lateral": (-0.4, 0.2)}


def wedge(document, compartment, horns=None, fine=1.0, parts=("lower", "wall", "upper")):
    """Corners in the tibia's frame, mm, and triangles, of the side of a knee document."""
    left = document["side"] == "left"
    right = mirror_document(document) if left else document
    plateau = build_surface(right["contacts"][compartment]["tibial_surface"])
    begin, end = np.deg2rad(HORNS[compartment] if horns is None else horns)
    turns = np.linspace(begin, end, round(90 * fine))
    across = np.linspace(0.0, 1.0, round(10 * fine))
    around = round(3 * fine) + 1  # up the wall and the inner edge
    part = np.concatenate([across, np.ones(around), across[::-1], np.zeros(around)])
    up = np.concatenate([0.0 * across, np.linspace(0.0, 1.0, around), 1.0 + 0.0 * across,
                         np.linspace(1.0, 0.0, around)])  # fmt: skip
    keep = np.r_[True, (np.diff(part) != 0.0) | (np.diff(up) != 0.0)]
    part, up = part[keep][:-1], up[keep][:-1]
    radius, (forwards, to_right) = INNER + (OUTER - INNER) * part, MIDDLE[compartment]
    x = forwards + np.outer(np.cos(turns), radius)
    z = to_right + np.outer(np.sin(turns), radius)
    ground = np.asarray(plateau.point(x.ravel(), z.ravel())[1]).reshape(x.shape)
    y = ground + up * (EDGE + (HEIGHT - EDGE) * part)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    count, n = x.shape[1], len(turns)
    row = np.arange(n * count).reshape(n, count)
    a, b = row[:-1], row[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    faces = np.stack([np.stack([a, c, b], -1), np.stack([a, d, c], -1)], axis=2)
    middles = 0.5 * (up + np.roll(up, -1))
    which = np.where(middles == 0.0, "lower", np.where(middles == 1.0, "upper", "wall"))
    faces = faces[:, np.isin(which, parts)].reshape(-1, 3)
    if len(parts) == 3:  # the ends of both horns, from a point in their middles
        for line, way, end in ((row[0], 1, points[row[0]]), (row[-1], -1, points[row[-1]])):
            fan = np.stack([np.full(count, len(points)), line, np.roll(line, -1)], axis=1)
            faces = np.concatenate([faces, fan[:, ::way]])
            points = np.vstack([points, end.mean(axis=0)])
    local = tuple(points.T)
    there = plateau.frame.placement.apply(local)
    points = np.stack([np.asarray(v) for v in there], axis=1)
    return (points * [1.0, 1.0, -1.0], faces[:, ::-1]) if left else (points, faces)
