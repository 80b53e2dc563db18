"""A knee of spheres on planes, and the same knee in OpenSim: let go until it rests, or for a time.

On these surfaces both programs state the same law. OpenSim's `ElasticFoundationForce` puts a spring
on each triangle of a meshed sphere, pressed along the plane's normal by its depth; a plane has no
triangles, so nothing is counted twice. Over a cap of depth `d` the springs sum to `pi k R d^2`
with `k = K / h`, through the sphere's centre, which is kneejax's closed form of a linear layer
without any approximation. What is left between the two is the mesh, whose triangles lie inside the
sphere, an error of second order in their size, and how long OpenSim is left to settle.

At rest nothing that depends on speed acts: mass and damping choose the way to the balance and how
long it takes, not where it is. For settling they are chosen so that OpenSim is quick; for a motion
they are those of the knee (`MovingKnee`), by the same laws in both programs.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import trimesh

import kneejax as kj
from kneejax.dynamics import MovingKnee
from kneejax.geometry import COORDINATES, FREE_COORDINATES, Frame, Plane, Sphere
from kneejax.mechanics import Contact, Knee, Mass

try:
    import opensim as osim
except ImportError:  # what needs it says so, or is skipped
    osim = None

MM = 1e-3
#: Metres or radians, per mm and degree of a row of `COLUMNS`.
_SI = np.r_[np.deg2rad([1.0, 1.0, 1.0]), MM, MM, MM]
#: Axes of the six coordinates, of which the first three turn one after the other.
_AXES = ((0, 0, -1), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))

#: kg; the radius of inertia and the arm at which rotations are damped, m; and damping, N s/m.
_MASS, _ARM, _DAMPING = 1.0, 0.03, 1600.0
#: Simulated seconds between two looks at the speed, and when a pose is given up.
_SLICE, _LONGEST = 0.1, 60.0
#: A pose is at rest when nothing moves faster, mm/s (rotations at `_ARM`).
SPEED_LIMIT = 1e-3
#: Of the integration, and how far a locked flexion may slip, rad.
_ACCURACY, _LOCK = 1e-3, 1e-6


def sphere_knee() -> Knee:
    """The bundled four-ligament knee on two spheres and two planes, of a linear layer.

    The spheres stand about the axis of the bundled condyles and touch about where these do. The
    planes have the slopes of paper 3: 2 degrees posterior and 2 medial, 7 posterior and 2 lateral.
    Corners are all but sharp, as they are in OpenSim.
    """
    knee = kj.load_knee("four_ligament")
    knee = eqx.tree_at(lambda k: k.ligaments.transition_width, knee, jnp.full(4, 1e-5))

    def compartment(lateral, radius, height, posterior_slope_deg, lateral_slope_deg):
        tilt = np.deg2rad([lateral_slope_deg, 0.0, posterior_slope_deg])
        return Contact(
            Sphere(radius, Frame([-3.0, -1.0, lateral])),
            Plane(Frame([0.0, height, lateral], tilt), half_extent=(25.0, 20.0)),
            law="linear",
            onset_width=1e-3,
        )

    medial = compartment(-18.0, 22.0, -22.6, 2.0, -2.0)
    lateral = compartment(20.0, 21.0, -21.6, 7.0, 2.0)
    return dataclasses.replace(knee, contacts=(medial, lateral))


@dataclasses.dataclass(frozen=True)
class Rest:
    """Where OpenSim came to rest.

    Attributes:
        pose: degrees and mm, in the order of `COLUMNS`.
        unbalanced: force that is left at rest on the free coordinates, `(5,)`: N mm twice, then
            N; from the accelerations that OpenSim itself computes there.
        seconds: of the wall's clock; likewise `processor_s` of the processor's.
        simulated_s: seconds of the knee's time.
    """

    pose: np.ndarray
    unbalanced: np.ndarray
    seconds: float
    processor_s: float
    simulated_s: float


@dataclasses.dataclass(frozen=True)
class Run:
    """A motion by OpenSim.

    Attributes:
        poses: degrees and mm, `(times, 6)`.
        seconds: of the wall's clock; likewise `processor_s` of the processor's.
    """

    poses: np.ndarray
    seconds: float
    processor_s: float


class SettlingKnee:
    """A knee of spheres on planes as an OpenSim model.

    Attributes:
        triangles: of the mesh of one sphere.
    """

    def __init__(self, knee: Knee, subdivisions: int, moving: MovingKnee | None = None):
        osim.Logger.setLevelString("error")
        self.triangles = 20 * 4**subdivisions
        self._lines = {line.name: float(line.tension) for line in knee.lines}
        self.model = osim.Model()
        self.model.setGravity(osim.Vec3(0.0))
        self._tibia = _body(Mass(_MASS, [0.0] * 3, np.eye(3) * _MASS * (_ARM / MM) ** 2)
                            if moving is None else moving.masses["tibia"])  # fmt: skip
        self.model.addBody(self._tibia)
        self._add_joint()
        if moving is None:
            self._add_damping()
        self._dissipation = {} if moving is None else moving.contact_dissipation
        self._add_ligaments(knee)
        self._add_lines(knee)
        with tempfile.TemporaryDirectory() as folder:
            for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
                file = Path(folder) / f"{name}.obj"
                ball = trimesh.creation.icosphere(subdivisions, float(contact.femoral.radius) * MM)
                ball.export(file)
                self._add_contact(name, contact, file)
            self._state = self.model.initSystem()
        self._coordinates = [self.model.getCoordinateSet().get(name) for name in COORDINATES]

    def solve_equilibrium(self, flexion_deg: float, begin: np.ndarray) -> Rest:
        """Let go of the knee at a flexion, which is locked, and wait until it rests.

        Args:
            flexion_deg: prescribed.
            begin: the pose at which it is let go, degrees and mm, `(6,)`; its flexion is not read.

        Returns:
            Where it rests.

        Raises:
            RuntimeError: it does not come to rest.
        """
        state = self._at(np.r_[flexion_deg, begin[1:]])
        wall, processor = time.perf_counter(), time.process_time()
        manager = self._manager(_ACCURACY)
        manager.initialize(state)
        until = 0.0
        while until < _LONGEST:
            until += _SLICE
            now = manager.integrate(until)
            if np.abs(_numbers(now.getU())[1:] * [_ARM, _ARM, 1, 1, 1]).max() < SPEED_LIMIT * MM:
                break
        else:
            raise RuntimeError(f"OpenSim does not come to rest at {flexion_deg} degrees")
        seconds = time.perf_counter() - wall, time.process_time() - processor
        pose = _numbers(now.getQ()) / _SI
        return Rest(pose, self.unbalanced(pose), *seconds, until)

    def motion(self, begin: np.ndarray, time_s: np.ndarray, accuracy: float) -> Run:
        """Let go of the knee, flexion locked, and say where it is at some times.

        Args:
            begin: the pose at which it is let go, degrees and mm, `(6,)`.
            time_s: rising, the start first.
            accuracy: of the integrator.
        """
        state = self._at(begin)
        wall, processor = time.perf_counter(), time.process_time()
        manager = self._manager(accuracy)
        manager.initialize(state)
        poses = [begin]
        for until in time_s[1:]:
            poses.append(_numbers(manager.integrate(float(until)).getQ()) / _SI)
        seconds = time.perf_counter() - wall, time.process_time() - processor
        return Run(np.array(poses), *seconds)

    def _manager(self, accuracy: float):
        manager = osim.Manager(self.model)
        manager.setIntegratorMethod(osim.Manager.IntegratorMethod_CPodes)
        manager.setIntegratorAccuracy(accuracy)
        manager.setIntegratorConstraintTolerance(_LOCK)
        manager.setWriteToStorage(False)
        manager.setPerformAnalyses(False)
        return manager

    def unbalanced(self, pose: np.ndarray) -> np.ndarray:
        """Force on the free coordinates of the knee at rest, `(5,)`: N mm twice, then N.

        Args:
            pose: degrees and mm, `(6,)`.
        """
        state = self._at(pose)
        self.model.realizeAcceleration(state)
        force = osim.Vector(6, 0.0)
        self.model.getMatterSubsystem().multiplyByM(state, state.getUDot(), force)
        return _numbers(force)[1:] / [MM, MM, 1.0, 1.0, 1.0]

    def _at(self, pose: np.ndarray):
        """The state of the knee at rest at a pose."""
        state, flexion = self._state, self._coordinates[0]
        state.setTime(0.0)
        flexion.setLocked(state, False)
        for coordinate, value in zip(self._coordinates, pose * _SI, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, 0.0)
        flexion.setLocked(state, True)
        for name, tension in self._lines.items():
            line = osim.ScalarActuator.safeDownCast(self.model.getForceSet().get(name))
            line.overrideActuation(state, True)
            line.setOverrideActuation(state, tension)
        return state

    def _add_joint(self) -> None:
        """The six coordinates of a `Pose`: turned in its order, shifted along the femur's axes."""
        transform = osim.SpatialTransform()
        for row, (axis, name) in enumerate(zip(_AXES, COORDINATES, strict=True)):
            entry = transform.updTransformAxis(row)
            entry.setCoordinateNames(osim.ArrayStr(name, 1))
            entry.setAxis(osim.Vec3(*axis))
            entry.set_function(osim.LinearFunction())
        self.model.addJoint(
            osim.CustomJoint("knee", self.model.getGround(), self._tibia, transform)
        )

    def _add_damping(self) -> None:
        for row, name in enumerate(FREE_COORDINATES):
            damper = osim.SpringGeneralizedForce(name)
            damper.setName(f"{name}_damper")
            damper.setStiffness(0.0)
            damper.setRestLength(0.0)
            damper.setViscosity(_DAMPING * (_ARM**2 if row < 2 else 1.0))
            self.model.addForce(damper)

    def _add_ligaments(self, knee: Knee) -> None:
        fibres, femur = knee.ligaments, self.model.getGround()
        for row, name in enumerate(fibres.names):
            fibre = osim.Blankevoort1991Ligament(
                name,
                femur,
                _metres(fibres.femoral_attachment[row]),
                self._tibia,
                _metres(fibres.tibial_attachment[row]),
                float(fibres.stiffness[row]),
                float(fibres.slack_length[row]) * MM,
            )
            fibre.set_transition_strain(float(fibres.transition_strain[row]))
            fibre.set_damping_coefficient(float(fibres.damping[row]))
            self.model.addForce(fibre)

    def _add_lines(self, knee: Knee) -> None:
        """Lines of constant tension, whose upper ends travel with flexion."""
        flexion = self.model.getJointSet().get(0).get_coordinates(0)
        for line in knee.lines:
            origin = osim.MovingPathPoint()
            origin.setName("origin")
            origin.setParentFrame(self.model.getGround())
            for axis, powers in zip("XYZ", np.asarray(line.origin).T * MM, strict=True):
                polynomial = osim.PolynomialFunction(osim.Vector.createFromMat(powers[::-1].copy()))
                getattr(origin, f"set_{axis.lower()}_location")(polynomial)
                getattr(origin, f"set{axis}Coordinate")(flexion)
            actuator = osim.PathActuator()
            actuator.setName(line.name)
            path = actuator.updGeometryPath()
            path.updPathPointSet().adoptAndAppend(origin)
            path.appendNewPathPoint("insertion", self._tibia, _metres(line.insertion))
            self.model.addForce(actuator)

    def _add_contact(self, name: str, contact: Contact, file: Path) -> None:
        condyle, plateau = f"{name}_condyle", f"{name}_plateau"
        self.model.addContactGeometry(
            osim.ContactMesh(
                str(file),
                _metres(contact.femoral.frame.origin),
                osim.Vec3(0.0),
                self.model.getGround(),
                condyle,
            )
        )
        # A half-space is solid where its X is positive: X points down the plane's normal, Y.
        frame = contact.tibial.frame
        turned = np.asarray(frame.rotation) - [0.0, 0.0, np.pi / 2]
        self.model.addContactGeometry(
            osim.ContactHalfSpace(
                _metres(frame.origin), osim.Vec3(*map(float, turned)), self._tibia, plateau
            )
        )
        force = osim.ElasticFoundationForce()
        force.setName(name)
        force.setStiffness(float(contact.modulus / contact.layer_thickness) * 1e6 / MM)
        force.setDissipation(float(self._dissipation.get(name, 0.0)) / MM)
        force.setStaticFriction(0.0)
        force.setDynamicFriction(0.0)
        force.setViscousFriction(0.0)
        force.addGeometry(condyle)
        force.addGeometry(plateau)
        self.model.addForce(force)


def _body(mass: Mass):
    inertia = np.asarray(mass.inertia_kg_mm2) * MM**2
    rows = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    turning = osim.Inertia(*(float(inertia[i, j]) for i, j in rows))
    return osim.Body("tibia", float(mass.mass_kg), _metres(mass.center_mm), turning)


def _metres(point_mm) -> osim.Vec3:
    return osim.Vec3(*(float(x) * MM for x in np.asarray(point_mm)))


def _numbers(vector) -> np.ndarray:
    return np.array([vector[i] for i in range(vector.size())])
