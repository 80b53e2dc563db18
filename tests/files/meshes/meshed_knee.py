"""A knee of simple shapes as meshes: what importers should find in it is known in closed form."""

import numpy as np

SPACING = 1.5
CENTRES = {"medial": -21.0, "lateral": 22.0}
RADIUS = {"medial": 23.0, "lateral": 21.0}


def sheet(place, first, second, counts):
    """Triangles of a map from two parameters, wound so that `first x second` points outwards."""
    ends = zip((first, second), counts, strict=True)
    a, b = np.meshgrid(*(np.linspace(*limits, count) for limits, count in ends), indexing="ij")
    points = np.stack(place(a, b), axis=-1).reshape(-1, 3)
    row = np.arange(counts[0] * counts[1]).reshape(counts)
    p, q, r, s = (x.ravel() for x in (row[:-1, :-1], row[1:, :-1], row[1:, 1:], row[:-1, 1:]))
    return points, np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])


def condyle_radius(name, angle, z):
    t = z - CENTRES[name]
    return RADIUS[name] + 1.2 * np.cos(angle) - 0.018 * t * t


def condyle(name, inwards=0.0):
    def place(z, angle):
        r = condyle_radius(name, angle, z) - inwards
        return r * np.cos(angle), -r * np.sin(angle), z

    middle = CENTRES[name]
    return sheet(place, (middle - 11, middle + 11), np.deg2rad([25, 235]), (20, 70))


def plateau_height(name, x, z):
    t = z - CENTRES[name]
    return -RADIUS[name] - 0.8 + 0.006 * x * x + 0.008 * t * t


def plateau(name, down=0.0):
    def place(z, x):
        return x, plateau_height(name, x, z) - down, z

    middle = CENTRES[name]
    return sheet(place, (middle - 11, middle + 11), (-17.0, 18.0), (20, 30))


def patella_depth(y, z):
    """Where the cartilage of a patella lies in front of its origin: two facets and a ridge."""
    return -8.0 + 3.0 * np.sqrt(4.0 + (0.5 * z) ** 2) / 2.0 + 0.01 * (y - 2.0) ** 2 + 0.02 * z


def patellar(forwards=0.0):
    def place(y, z):
        return patella_depth(y, z) + forwards, y, z

    # Up crossed with lateral points forwards: wound the other way round.
    points, faces = sheet(place, (-13.0, 15.0), (-20.0, 21.0), (24, 34))
    return points, faces[:, ::-1]


def joined(*parts):
    offset = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.concatenate([points for points, _ in parts])
    return points, np.concatenate([f + o for (_, f), o in zip(parts, offset[:-1], strict=True)])


def femoral(inwards=0.0):
    return joined(condyle("medial", inwards), condyle("lateral", inwards))


def tibial(down=0.0):
    return joined(plateau("medial", down), plateau("lateral", down))


def mirrored(part):
    return part[0] * np.array([1.0, 1.0, -1.0]), part[1][:, ::-1]


def written(path, part, scale=1.0):
    """An STL file (of single precision) or, where its name says so, a PLY file."""
    import trimesh

    trimesh.Trimesh(part[0] * scale, part[1], process=False).export(path)
    return path
