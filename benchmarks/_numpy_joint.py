"""Paper 5's constraint equations in plain NumPy, solved by searches: shares no code with kneejax.

Unknown are adduction, internal rotation (rad) and translation (mm) at a given flexion. What ties
them is the revolute joint between the invisible segments: one origin, one axis.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import fsolve


class NumpyJoint:
    """Axis points of a linear moving axis, read once."""

    def __init__(self, joint):
        self.flexion = np.asarray(joint.flexion)
        self.femoral, self.tibial = np.asarray(joint.femoral), np.asarray(joint.tibial)

    def residual(self, flexion, y):
        """Five equations at `y` `(5, lanes)`, lanes of `flexion`; complex `y` are welcome."""
        first, last = self.flexion
        share = np.clip((flexion - first) / (last - first), 0.0, 1.0)
        f, t = (p[0][..., None] * (1 - share) + p[1][..., None] * share
                for p in (self.femoral, self.tibial))  # fmt: skip
        turn = _rotation(flexion, y[0], y[1])
        apart = f[0] - y[2:] - np.einsum("ijl,jl->il", turn, t[0])
        axis = np.einsum("ijl,jl->il", turn, _unit(t[1] - t[0]))
        wanted = _unit(f[1] - f[0])
        across = np.stack([wanted[1] * axis[2] - wanted[2] * axis[1],
                           wanted[2] * axis[0] - wanted[0] * axis[2]])  # fmt: skip
        return np.concatenate([apart, across])

    def newton(self, flexion, y):
        """All lanes at once: Newton's method, Jacobians by complex steps. Returns y and steps."""
        for step in range(1, 30):
            value = self.residual(flexion, y)
            if np.abs(value).max() < 1e-12:
                return y, step
            columns = [
                self.residual(flexion, y + 1e-30j * unit[:, None]).imag / 1e-30
                for unit in np.eye(5)
            ]
            jacobian = np.moveaxis(np.stack(columns, axis=1), -1, 0)
            y = y - np.linalg.solve(jacobian, value.T[..., None])[..., 0].T
        raise RuntimeError("no convergence")

    def one_by_one(self, flexion, y):
        """SciPy's `fsolve` from pose to pose, as a kinematic analysis in time does."""
        poses = []
        for angle in flexion:
            here = np.array([angle])
            y = fsolve(lambda x, at=here: self.residual(at, x[:, None])[:, 0], y, xtol=1e-12)
            poses.append(y)
        return np.array(poses).T


def _unit(a):
    return a / np.sqrt((a * a).sum(axis=0))


def _rotation(flexion, adduction, internal):
    cf, sf = np.cos(flexion), np.sin(flexion)
    ca, sa, ci, si = np.cos(adduction), np.sin(adduction), np.cos(internal), np.sin(internal)
    return np.array([
        [cf * ci + sf * sa * si, sf * ca, cf * si - sf * sa * ci],
        [cf * sa * si - sf * ci, cf * ca, -sf * si - cf * sa * ci],
        [-ca * si, sa + 0 * cf, ca * ci],
    ])  # fmt: skip
