"""Placeholder so that the package imports until the obstacles are here; overwrite freely."""

import equinox as eqx


class Obstacle(eqx.Module):
    pass


class WrapSphere(Obstacle):
    pass


class WrapCylinder(Obstacle):
    pass


class WrapEllipsoid(Obstacle):
    pass


class TautPath(eqx.Module):
    pass


def taut(obstacle, start, end, width):
    raise NotImplementedError


def path_points(obstacle, start, end, count):
    raise NotImplementedError
