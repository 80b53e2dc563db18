"""The four-ligament knee once more, in plain NumPy: a peer that shares no code with kneejax.

Same equations: the smooth ligament law, two elliptical patches with the log law between condyle
and plateau polynomials, the line of constant tension. Forces are exact: the derivative of the
energy by complex steps, taken in one vectorised evaluation, the contact points following in
complex arithmetic. Arrays end in lanes.
"""

from __future__ import annotations

import numpy as np

UNITS = np.array([1 / 30, 1 / 30, 1.0, 1.0, 1.0])  # rad and mm for one unit of an unknown
_STEP = 1e-30


class NumpyKnee:
    """Numbers of a knee, read once."""

    def __init__(self, knee):
        if any(c.law != "log" or not c.has_patch for c in knee.contacts) or knee.loads:
            raise ValueError("this peer knows elliptical patches with the log law and no loads")
        lig, line, contacts = knee.ligaments, knee.lines[0], knee.contacts
        self.a = np.asarray(lig.femoral_attachment)[..., None]
        self.b = np.asarray(lig.tibial_attachment)[..., None]
        self.stiffness = np.asarray(lig.stiffness)[:, None]
        self.slack = np.asarray(lig.slack_length)[:, None]
        self.toe = np.asarray(lig.transition_strain)[:, None]
        self.width = np.asarray(lig.transition_width)[:, None]
        self.pull, self.insertion = float(line.tension), np.asarray(line.insertion)[:, None]
        self.origin = np.asarray(line.origin)

        def stack(get):
            return np.stack([np.asarray(get(c)) for c in contacts], axis=-1)[..., None]

        self.femur_origin = stack(lambda c: c.femoral.frame.origin)
        self.tibia_origin = stack(lambda c: c.tibial.frame.origin)
        self.radius = stack(lambda c: c.femoral.coefficients)
        self.eta = stack(lambda c: c.tibial.coefficients)
        self.angle = stack(lambda c: c.femoral.angle)
        self.along = stack(lambda c: c.femoral.width)
        self.x, self.z = stack(lambda c: c.tibial.x), stack(lambda c: c.tibial.z)
        self.modulus = stack(lambda c: c.modulus)
        self.layer = stack(lambda c: c.layer_thickness)
        self.onset = stack(lambda c: c.onset_width)
        self.contact_points = None

    def energy(self, flexion, q, contact_points):
        """Energy `(lanes,)`, N mm, at `q` `(5, lanes)` with contact points `(2, 2, lanes)`."""
        turn, shift = _rotation(flexion, q), q[2:]
        line = np.einsum("ijl,njl->nil", turn, self.b + 0 * turn[:1, 0]) + shift - self.a
        strain = _size(line, 1) / self.slack - 1.0
        bowls = _bowl(strain, self.width) - _bowl(strain - self.toe, self.width)
        energy = np.sum(self.stiffness * self.slack / self.toe * bowls, axis=0)
        end = np.polynomial.polynomial.polyval(flexion, self.origin)[:, None]
        tip = np.einsum("ijl,jl->il", turn, self.insertion + 0 * shift) + shift - end
        energy = energy + self.pull * _size(tip, 0)
        g, _, (aa, ab, bb), steep, metric = self.gap(turn, shift, contact_points)
        depth = -g / np.sqrt(steep)
        depth = 0.5 * (depth + np.sqrt(depth * depth + self.onset**2))
        curvature = (aa * bb - ab * ab) / (metric * steep)
        curvature = np.where((curvature.real < 1e-6) | (aa.real < 0), 1e-6, curvature)
        area = 2.0 * np.pi * depth * curvature**-0.5
        patch = self.modulus * self.layer * area * _patch_mean(depth / self.layer)
        return energy + np.sum(patch, axis=0)

    def gap(self, turn, shift, contact_points):
        """Height of femoral points over the plateau, slopes, second derivatives, steepness and
        metric. Arrays `(compartments, lanes)`; `contact_points` `(2, compartments, lanes)`."""
        angle, along = contact_points
        (r, r_b, r_bb), (r_a, r_ab), (r_aa,) = _partials(
            self.radius, self.angle, self.along, angle, along
        )
        c, s, zero, one = np.cos(angle), np.sin(angle), 0 * angle, 1 + 0 * angle
        jet = np.array([
            [r * c, -r * s, along],
            [r_a * c - r * s, -r_a * s - r * c, zero],
            [r_b * c, -r_b * s, one],
            [(r_aa - r) * c - 2 * r_a * s, -(r_aa - r) * s - 2 * r_a * c, zero],
            [r_ab * c - r_b * s, -r_ab * s - r_b * c, zero],
            [r_bb * c, -r_bb * s, zero],
        ])  # fmt: skip
        jet[0] += self.femur_origin - shift[:, None]
        p, a, b, aa, ab, bb = np.einsum("jil,kjcl->kicl", turn, jet)  # into the tibia
        p = p - self.tibia_origin
        (h, h_z, h_zz), (h_x, h_xz), (h_xx,) = _partials(self.eta, self.x, self.z, p[0], p[2])

        def down(v):
            return v[1] - h_x * v[0] - h_z * v[2]

        def bent(v, w):
            return h_xx * v[0] * w[0] + h_xz * (v[0] * w[2] + v[2] * w[0]) + h_zz * v[2] * w[2]

        second = (down(aa) - bent(a, a), down(ab) - bent(a, b), down(bb) - bent(b, b))
        metric = np.sum(a * a, 0) * np.sum(b * b, 0) - np.sum(a * b, 0) ** 2
        return p[1] - h, (down(a), down(b)), second, 1 + h_x**2 + h_z**2, metric

    def follow(self, flexion, q, contact_points, steps):
        """Newton steps of the contact points."""
        turn, shift = _rotation(flexion, q), q[2:]
        for _ in range(steps):
            _, (a, b), (aa, ab, bb), _, _ = self.gap(turn, shift, contact_points)
            det = aa * bb - ab * ab
            step = np.stack([(bb * a - ab * b) / det, (aa * b - ab * a) / det])
            contact_points = contact_points - step
            if np.max(np.abs(step)) < 1e-10:
                break
        return contact_points

    def forces(self, flexion, y):
        """Derivative of the energy by the scaled unknowns `(5, lanes)`, exact."""
        q = y * UNITS[:, None]
        count = q.shape[1]
        start = np.broadcast_to(self.contact_points, (2, 2, count))
        here = self.follow(flexion, q, start, 12)
        if count == 1:
            self.contact_points = here
        pushed = np.repeat(q, 5, axis=1) + 1j * _STEP * np.tile(np.diag(UNITS), count)
        moved = self.follow(flexion, pushed, np.repeat(here, 5, axis=2).astype(complex), 2)
        energy = self.energy(flexion, pushed, moved)
        return (energy.imag / _STEP).reshape(count, 5).T

    def residual(self, y, flexion):
        """For `scipy.optimize.root`."""
        return self.forces(flexion, y[:, None])[:, 0]

    def jacobian(self, y, flexion):
        """Central differences of the exact forces, all columns in one evaluation."""
        nudge = np.eye(5) * 1e-5
        both = self.forces(flexion, np.hstack([y[:, None] + nudge, y[:, None] - nudge]))
        return (both[:, :5] - both[:, 5:]) / 2e-5


def _rotation(flexion, q):
    cf, sf = np.cos(flexion), np.sin(flexion)
    (ca, ci), (sa, si) = np.cos(q[:2]), np.sin(q[:2])
    return np.array([
        [cf * ci + sf * sa * si, sf * ca, cf * si - sf * sa * ci],
        [cf * sa * si - sf * ci, cf * ca, -sf * si - cf * sa * ci],
        [-ca * si, sa, ca * ci],
    ])  # fmt: skip


def _size(vector, axis):
    return np.sqrt(np.sum(vector * vector, axis=axis))


def _bowl(x, w):
    square = x * x + w * w
    root = np.sqrt(square)
    return (x**3 + square * root) / 12 + 0.25 * w * w * (x * np.arcsinh(x / w) - root)


def _patch_mean(c):
    """Mean over a patch of the log law's energy per area."""
    series = sum(c**n / (n * (n - 1) * (n + 1)) for n in range(2, 12))
    rest = 1.0 - c
    large = np.where(np.abs(c) < 0.04, 0.5, c)
    with np.errstate(invalid="ignore", divide="ignore"):
        closed = 0.25 * (rest * rest - 1) + 0.5 * (c * c - rest * rest * np.log1p(-c))
    return np.where(np.abs(c) < 0.04, series, closed / large)


def _partials(table, limits_s, limits_t, s, t):
    """Partial derivatives up to the second order of a polynomial in scaled variables."""
    by_s, by_t = (2.0 / (x[1] - x[0]) for x in (limits_s, limits_t))
    rows = _powers((s - limits_s[0]) * by_s - 1.0, table.shape[0], by_s)
    columns = _powers((t - limits_t[0]) * by_t - 1.0, table.shape[1], by_t)
    half = [np.sum(table * c, axis=1) for c in columns]
    return [[np.sum(rows[i] * half[j], axis=0) for j in range(3 - i)] for i in range(3)]


def _powers(x, count, scale):
    """Powers of a scaled variable and their first two derivatives, `(count, ...)` each."""
    power = [1.0 + 0 * x]
    for _ in range(count - 1):
        power.append(power[-1] * x)
    zero = 0 * x
    first = [zero] + [k * power[k - 1] * scale for k in range(1, count)]
    second = [zero, zero] + [k * (k - 1) * power[k - 2] * scale**2 for k in range(2, count)]
    return np.array(power), np.array(first), np.array(second[:count])
