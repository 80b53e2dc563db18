"""A ligament band of fibres beside the same of finite elements (`pip install scikit-fem`).

The band is a straight bar of elliptical cross-section, tied to rigid bones at both ends as paper 4
ties its ligaments, of a nearly incompressible neo-Hookean material. It is stretched, and then, held
at a stretch, turned about its length and about the wide axis of its cross-section. Printed are the
forces and moments on the far end by finite elements (27-node bricks) and by 24 fibres.

    python band_beside_finite_elements.py
"""

import argparse
import time

import numpy as np
import scipy.sparse.linalg
from skfem import Basis, ElementHex2, ElementVector, LinearForm, MeshHex, asm
from skfem import BilinearForm as Bilinear
from skfem.helpers import ddot, grad

import kneejax as kj
import kneejax.geometry as geo
from kneejax.mechanics import AttachmentArea, Ligaments, Wrench, fibre_field

MODULUS_MPA, HALF_AXES_MM, LENGTH_MM = 120.0, (6.0, 3.0), 30.0


def bar(across: int, along: int) -> MeshHex:
    """Bricks in an elliptical bar along -y, its near end at the origin."""
    ticks = np.linspace(-1.0, 1.0, across + 1)
    mesh = MeshHex.init_tensor(ticks, ticks, np.linspace(0.0, 1.0, along + 1))
    u, v, height = mesh.p
    # A square's image in a disc: circles for squares.
    x, y = u * np.sqrt(1.0 - 0.5 * v**2), v * np.sqrt(1.0 - 0.5 * u**2)
    a, b = HALF_AXES_MM
    return MeshHex(np.stack([a * x, -LENGTH_MM * height, b * y]), mesh.t)


def stress(F, poisson):
    """Nominal stress of `mu/2 (I1 - 3 - 2 ln J) + lambda/2 (ln J)^2`, and its slope."""
    shear = MODULUS_MPA / (2.0 * (1.0 + poisson))
    bulk = MODULUS_MPA * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    inverse = np.linalg.inv(np.moveaxis(F, (0, 1), (-2, -1)))
    log = np.log(1.0 / np.linalg.det(inverse))
    inverse = np.moveaxis(inverse, (-2, -1), (0, 1))
    turned = np.swapaxes(inverse, 0, 1)
    first = shear * (F - turned) + bulk * log * turned
    unit = np.eye(3)
    slope = (
        shear * np.einsum("ik,jl->ijkl", unit, unit)[..., None, None]
        + (shear - bulk * log) * np.einsum("li...,jk...->ijkl...", inverse, inverse)
        + bulk * np.einsum("ji...,lk...->ijkl...", inverse, inverse)
    )
    return first, slope


def finite_elements(poses, poisson, across, along):
    """Force and moment on the far end, about its middle, for a sequence of its poses.

    Args:
        poses: rotation matrix and shift of each, mm, from the one before in small steps.
        poisson: Poisson's ratio.
        across: bricks across the cross-section.
        along: bricks along the bar.
    """
    mesh = bar(across, along)
    basis = Basis(mesh, ElementVector(ElementHex2()), intorder=4)
    places = np.zeros((basis.N, 3))
    for axis in range(3):  # where every degree of freedom is
        places[:, axis] = basis.doflocs[axis]
    component = np.zeros(basis.N, int)
    for axis, name in enumerate(("u^1", "u^2", "u^3")):
        component[basis.get_dofs(elements=True).all([name])] = axis
    near = np.flatnonzero(places[:, 1] > -1e-9)
    far = np.flatnonzero(places[:, 1] < -LENGTH_MM + 1e-9)
    free = np.setdiff1d(np.arange(basis.N), [*near, *far])
    middle = np.array([0.0, -LENGTH_MM, 0.0])

    def linearised(u):
        F = grad(basis.interpolate(u)) + np.eye(3)[..., None, None]
        first, slope = stress(F, poisson)

        @LinearForm
        def residual(v, w):
            return ddot(first, grad(v))

        @Bilinear
        def tangent(u_, v, w):
            return np.einsum("ijkl...,kl...,ij...->...", slope, grad(u_), grad(v))

        return asm(residual, basis), asm(tangent, basis).tocsr()

    u, found = np.zeros(basis.N), []
    for turn, shift in poses:
        moved = (places - middle) @ (turn - np.eye(3)).T + shift
        target = moved[far, component[far]]
        step = np.zeros(basis.N)
        step[far] = target - u[far]
        for _ in range(25):
            force, tangent = linearised(u)
            known = tangent[free][:, far] @ step[far]
            step[free] = scipy.sparse.linalg.spsolve(
                tangent[free][:, free].tocsc(), -force[free] - known
            )
            u = u + step
            size, step = np.abs(step).max(), np.zeros(basis.N)
            if size < 1e-9:
                break
        force, _ = linearised(u)
        there = (places - middle)[far] @ turn.T
        each = np.zeros((len(far), 3))
        each[np.arange(len(far)), component[far]] = -force[far]
        found.append(np.array([*each.sum(axis=0), *np.cross(there, each).sum(axis=0)]))
    return np.array(found)


def fibres(poses, count=24):
    """The same by fibres."""
    a, b = HALF_AXES_MM
    axes = np.array([[a, 0.0, 0.0], [0.0, 0.0, b]])
    near, far = (AttachmentArea(np.array([0.0, y, 0.0]), axes) for y in (0.0, -LENGTH_MM))
    field = fibre_field(near, far, MODULUS_MPA, np.pi * a * b, 1.0, count)
    numbers = [np.full(count, x) for x in (LENGTH_MM, 0.06, 1e-5)]
    names, laws = [str(k) for k in range(count)], ("neo_hookean",) * count
    middle, found = np.array([0.0, -LENGTH_MM, 0.0]), []
    for turn, shift in poses:
        ends = (field.tibial - middle) @ turn.T + middle + shift
        placed = Ligaments(field.femoral, ends, field.stiffness, *numbers, names, laws=laws)
        pulls, _, _ = placed.pull(geo.State({"tibia": geo.Pose.from_table([0.0] * 6)}))
        total = Wrench.total(pulls.between[geo.FEMUR_AND_TIBIA])
        force, moment = np.array([*total.force]), np.array([*total.moment])
        found.append(np.array([*force, *(moment - np.cross(middle + shift, force))]))
    return np.array(found)


def about(axis, degrees):
    """A rotation matrix about a coordinate axis."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    j, k = [(1, 2), (2, 0), (0, 1)][axis]
    turn = np.eye(3)
    turn[j, j], turn[j, k], turn[k, j], turn[k, k] = c, -s, s, c
    return turn


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--across", type=int, default=4, help="bricks across")
    parser.add_argument("--along", type=int, default=8, help="bricks along")
    asked = parser.parse_args()
    kj.configure()
    strains, angles = np.array([0.02, 0.04, 0.06, 0.08]), np.array([0.0, 10.0, 20.0, 30.0])

    def pulled(strain):
        return np.array([0.0, -strain * LENGTH_MM, 0.0])

    cases = {
        "stretched": ([(np.eye(3), pulled(x)) for x in strains], 1, strains, "strain", "force, N"),
        "turned about its length at 6 %": (
            [(about(1, x), pulled(0.06)) for x in angles], 4, angles, "deg", "moment, N mm"),
        "bent about its wide axis at 6 %": (
            [(about(0, x), pulled(0.06)) for x in angles], 3, angles, "deg", "moment, N mm"),
    }  # fmt: skip
    for title, (poses, row, given, unit, what) in cases.items():
        ours = np.abs(fibres(poses)[:, row])
        print(f"\n{title}: {what}; {unit} {', '.join(f'{x:g}' for x in given)}")
        print(f"  24 fibres:        {'  '.join(f'{x:8.1f}' for x in ours)}")
        for poisson in (0.3, 0.45, 0.49):
            begun = time.perf_counter()
            found = np.abs(finite_elements(poses, poisson, asked.across, asked.along)[:, row])
            shares = [f"{a / b:.2f}" for a, b in zip(ours, found, strict=True) if b > 1e-6]
            print(
                f"  elements, nu {poisson:4.2f}: {'  '.join(f'{x:8.1f}' for x in found)}"
                f"   fibres / elements {', '.join(shares)}"
                f"   ({time.perf_counter() - begun:.0f} s)",
                flush=True,
            )


if __name__ == "__main__":
    main()
