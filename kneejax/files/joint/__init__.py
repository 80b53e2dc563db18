"""Joint files, their axes and landmarks, and their export."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.joint._file import JointExport as JointExport
    from kneejax.files.joint._file import JointFile as JointFile
    from kneejax.files.joint._file import export_joint as export_joint
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
    lazy_imports(globals())
