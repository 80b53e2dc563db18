"""Joint files, their axes and landmarks, and their export."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module, imported when one of its names is first asked for.
_MODULES = {
    "AxisPoints": "kneejax.files.joint._landmarks",
    "read_axis_points": "kneejax.files.joint._landmarks",
    "write_axis_points": "kneejax.files.joint._landmarks",
    "JointExport": "kneejax.files.joint._export",
    "export_joint": "kneejax.files.joint._export",
    "JointFile": "kneejax.files.joint._file",
    "format_joint": "kneejax.files.joint._file",
    "read_joint": "kneejax.files.joint._file",
    "write_joint": "kneejax.files.joint._file",
    "FemurLandmarks": "kneejax.files.joint._landmarks",
    "TibiaLandmarks": "kneejax.files.joint._landmarks",
    "read_femur_landmarks": "kneejax.files.joint._landmarks",
    "read_tibia_landmarks": "kneejax.files.joint._landmarks",
}

if TYPE_CHECKING:
    from kneejax.files.joint._export import JointExport as JointExport
    from kneejax.files.joint._export import export_joint as export_joint
    from kneejax.files.joint._file import JointFile as JointFile
    from kneejax.files.joint._file import format_joint as format_joint
    from kneejax.files.joint._file import read_joint as read_joint
    from kneejax.files.joint._file import write_joint as write_joint
    from kneejax.files.joint._landmarks import AxisPoints as AxisPoints
    from kneejax.files.joint._landmarks import FemurLandmarks as FemurLandmarks
    from kneejax.files.joint._landmarks import TibiaLandmarks as TibiaLandmarks
    from kneejax.files.joint._landmarks import read_axis_points as read_axis_points
    from kneejax.files.joint._landmarks import read_femur_landmarks as read_femur_landmarks
    from kneejax.files.joint._landmarks import read_tibia_landmarks as read_tibia_landmarks
    from kneejax.files.joint._landmarks import write_axis_points as write_axis_points
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
