"""An indenter on a layer, and a meniscus ring, beside finite elements (`pip install scikit-fem`).

A rigid sphere without friction is pressed into an elastic layer that is tied to rigid bone. Beside
axisymmetric elements (nine nodes, small strains, contact by active sets) stands kneejax's contact,
an elastic foundation: pressure is the confined modulus times depth over thickness, at each point
by itself. Then a ring with the wedge of a meniscus as its cross-section lies on a plateau without
friction, with pressure on its upper side, beside the ring of `kneejax.mechanics.Ring` and its
closed form u = P R / (E A), P the outward push for each radian.

    python contact_beside_finite_elements.py
"""

import argparse

import jax.numpy as jnp
import numpy as np
import scipy.sparse.linalg
from skfem import Basis, ElementQuad2, ElementVector, FacetBasis, LinearForm, MeshQuad, asm
from skfem import BilinearForm as Bilinear

import kneejax as kj
import kneejax.geometry as geo
from kneejax.mechanics import Contact, Ring

RADIUS_MM, MODULUS_MPA = 20.0, 10.0


def stiffness_of(basis, moduli, poisson):
    """Axisymmetric stiffness matrix, about the second axis.

    Args:
        basis: of radial and axial displacement.
        moduli: radially, around and axially, MPa.
        poisson: between any two of these, of the stiffer one to the softer.
    """
    shares = np.diag(1.0 / np.asarray(moduli, float))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        shares[i, j] = shares[j, i] = -poisson / max(moduli[i], moduli[j])
    law, shear = np.linalg.inv(shares), moduli[0] / (2.0 * (1.0 + poisson))

    def strain(u, r):
        return np.stack([u.grad[0, 0], u[0] / r, u.grad[1, 1]]), u.grad[0, 1] + u.grad[1, 0]

    @Bilinear
    def form(u, v, w):
        (one, slide), (other, slid) = strain(u, w.x[0]), strain(v, w.x[0])
        inner = np.einsum("ij,j...,i...->...", law, one, other)
        return 2.0 * np.pi * w.x[0] * (inner + shear * slide * slid)

    return asm(form, basis).tocsr()


def indented(thickness, poisson, depths, fineness):
    """Force, N, contact area, mm^2, and largest pressure, MPa, at depths of a sphere in a layer."""
    near = 1.1 * np.sqrt(2.0 * RADIUS_MM * max(depths))  # no larger is the area of contact
    beyond = 6.0 * thickness * np.linspace(0.0, 1.0, 2 * fineness + 1)[1:] ** 2
    r = np.r_[np.linspace(0.0, near, 6 * fineness + 1), near + beyond]
    z = -thickness * np.linspace(0.0, 1.0, fineness + 1)[::-1] ** 1.3
    mesh = MeshQuad.init_tensor(r, z)
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=5)
    matrix = stiffness_of(basis, (MODULUS_MPA,) * 3, poisson)
    up = basis.get_dofs(elements=True).all(["u^2"])
    (x, y), is_up = basis.doflocs, np.isin(np.arange(basis.N), up)
    held = np.flatnonzero((y < -thickness + 1e-9) | ((x < 1e-9) & ~is_up))
    top = np.flatnonzero((y > -1e-9) & is_up)
    top = top[np.argsort(x[top])]
    rise = RADIUS_MM - np.sqrt(np.maximum(RADIUS_MM**2 - x[top] ** 2, 0.0))
    found = []
    for depth in depths:
        touch = rise < 0.5 * depth
        for _ in range(60):
            fixed = np.r_[held, top[touch]]
            given = np.r_[np.zeros(len(held)), rise[touch] - depth]
            free = np.setdiff1d(np.arange(basis.N), fixed)
            u = np.zeros(basis.N)
            u[fixed] = given
            u[free] = scipy.sparse.linalg.spsolve(
                matrix[free][:, free].tocsc(), -matrix[free][:, fixed] @ given
            )
            push = -(matrix @ u)[top]
            after = np.where(touch, push > 0.0, u[top] > rise - depth + 1e-12)
            if (after == touch).all():
                break
            touch = after
        end = np.flatnonzero(touch)[-1]  # contact ends halfway to the next node
        area = np.pi * (0.5 * (x[top[end]] + x[top[end + 1]])) ** 2
        found.append((push.sum(), area, pressure_within(basis, u, poisson, x[top[2]])))
    return np.array(found)


def pressure_within(basis, u, poisson, radius):
    """Axial pressure at the surface, the mean around the axis, MPa."""
    rim = FacetBasis(basis.mesh, basis.elem, intorder=5,
                     facets=basis.mesh.facets_satisfying(
                         lambda x: (x[1] > -1e-9) & (x[0] < radius)))  # fmt: skip
    own = rim.interpolate(u)
    lame = MODULUS_MPA * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    r = rim.global_coordinates()[0]
    axial = own.grad[1, 1]
    spread = own.grad[0, 0] + own[0] / r + axial
    stress = lame * spread + MODULUS_MPA / (1.0 + poisson) * axial
    return -float(np.sum(stress * r * rim.dx) / np.sum(r * rim.dx))


def on_foundation(thickness, poisson, depths):
    """The same of kneejax's contact over points."""
    sphere = geo.Sphere(RADIUS_MM, geo.Frame([0.0, RADIUS_MM, 0.0]))
    plane = geo.Plane(half_extent=[10.0, 10.0])
    contact = Contact(sphere, plane, MODULUS_MPA, poisson, thickness, onset_width=1e-4,
                      law="linear", form="quadrature", points=(200, 200))  # fmt: skip
    found = []
    for depth in depths:
        tibia = geo.State({"tibia": geo.Pose.from_table([0, 0, 0, 0, depth, 0])}).tibia.placement
        sampled = contact.foundation.sample(tibia)
        points = sampled.points
        pressure = points.pressure(sampled.depth)
        touching = jnp.sum(points.touching(sampled.depth) * points.area)
        found.append((float(jnp.sum(pressure * points.area)), float(touching),
                      float(jnp.max(pressure))))  # fmt: skip
    return np.array(found)


def ring_of_elements(inner, outer, heights, moduli, poisson, pressure, fineness):
    """Mean outward motion, mm, of a ring with a wedge's cross-section, by pressure on top; also
    its cross-section, mm^2, and the outward push for each radian, N."""
    mesh = MeshQuad.init_tensor(*[np.linspace(0.0, 1.0, fineness + 1)] * 2)
    s, t = mesh.p
    height = np.interp(s, [0.0, 1.0], heights)
    mesh = MeshQuad(np.stack([inner + (outer - inner) * s, t * height]), mesh.t)
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=5)
    matrix = stiffness_of(basis, moduli, poisson)
    top = FacetBasis(mesh, basis.elem, intorder=5, facets=mesh.facets_satisfying(
        lambda x: np.abs(x[1] - np.interp(x[0], [inner, outer], heights)) < 1e-9,
        boundaries_only=True))  # fmt: skip

    @LinearForm
    def load(v, w):
        return -pressure * 2.0 * np.pi * w.x[0] * (v[0] * w.n[0] + v[1] * w.n[1])

    up = np.isin(np.arange(basis.N), basis.get_dofs(elements=True).all(["u^2"]))
    held = np.flatnonzero((basis.doflocs[1] < 1e-9) & up)
    free, u = np.setdiff1d(np.arange(basis.N), held), np.zeros(basis.N)
    push = asm(load, top)
    u[free] = scipy.sparse.linalg.spsolve(matrix[free][:, free].tocsc(), push[free])
    area, moved = np.sum(basis.dx), np.sum(basis.interpolate(u)[0] * basis.dx)
    return float(moved / area), float(area), float(push[~up].sum() / (2.0 * np.pi))


def ring_alone(radius, area, modulus, push):
    """Outward motion, mm, by kneejax's ring and by the closed form."""
    ring = Ring(modulus, area, 1e9, 1e-9, [0.0, 0.0], [0.0, 2.0 * np.pi], sections=12)
    turns = 2.0 * np.pi * (np.arange(240) + 0.5) / 240
    points = geo.Vector(radius * np.cos(turns), 0.0 * turns, radius * np.sin(turns))
    hoop = ring.hoop(points, jnp.ones(240))
    # All sections alike: the hoop is longer by 2 pi u, and its tension is the push.
    return push / float(hoop * ring.angle), push * radius / (modulus * area)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--fineness", type=int, default=10, help="elements across the layer")
    fineness = parser.parse_args().fineness
    kj.configure()
    print("sphere of 20 mm on a layer: force, area, largest pressure of elements; foundation "
          "/ elements")  # fmt: skip
    for ratio in (0.05, 0.15, 0.3):
        thickness = ratio * RADIUS_MM
        depths = thickness * np.array([0.05, 0.1, 0.2])
        for poisson in (0.2, 0.3, 0.45, 0.49):
            theirs = indented(thickness, poisson, depths, fineness)
            ours = on_foundation(thickness, poisson, depths)
            for depth, one, share in zip(depths, theirs, ours / theirs, strict=True):
                print(f"  h/R {ratio:4.2f}  nu {poisson:4.2f}  d/h {depth / thickness:4.2f}"
                      f"  a/h {np.sqrt(one[1] / np.pi) / thickness:4.1f}  {one[0]:8.2f} N"
                      f" {one[1]:7.2f} mm^2 {one[2]:6.3f} MPa   "
                      + "  ".join(f"{x:4.2f}" for x in share), flush=True)  # fmt: skip
    print("ring, radii 10 and 20 mm, 0.5 to 8 mm high, 0.5 MPa on top: outward motion, mm")
    for moduli, what in (((20.0,) * 3, "20 MPa all ways"), ((20.0, 120.0, 20.0), "120 MPa around")):
        mean, area, push = ring_of_elements(10.0, 20.0, (0.5, 8.0), moduli, 0.2, 0.5, 2 * fineness)
        middle = 10.0 + 10.0 * (0.5 + 2.0 * 8.0) / (3.0 * 8.5)
        ours, closed = ring_alone(middle, area, moduli[1], push)
        print(f"  {what}: elements {mean:.3f}, ring {ours:.3f}, closed form {closed:.3f}"
              f"   ring / elements {ours / mean:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
