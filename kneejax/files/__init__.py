"""Knee files, studies, tables and meshes: the only rooms that touch a disk."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: what is bundled, and what a mistake is called, is said without JAX.
_MODULES = {
    "Measurement": "kneejax.files._bundled",
    "absent_measurement": "kneejax.files._bundled",
    "bundled_knee_descriptions": "kneejax.files._bundled",
    "bundled_knees": "kneejax.files._bundled",
    "bundled_measurements": "kneejax.files._bundled",
    "bundled_path": "kneejax.files._bundled",
    "bundled_studies": "kneejax.files._bundled",
    "load_knee": "kneejax.files._bundled",
    "load_knee_file": "kneejax.files._bundled",
    "study_path": "kneejax.files._bundled",
    "Calibrated": "kneejax.files._calibrated",
    "read_calibrated": "kneejax.files._calibrated",
    "CandidateRow": "kneejax.files._candidates",
    "read_candidates": "kneejax.files._candidates",
    "Checkpoints": "kneejax.files._checkpoints",
    "AxisPoints": "kneejax.files._joint_axes",
    "read_axis_points": "kneejax.files._joint_axes",
    "write_axis_points": "kneejax.files._joint_axes",
    "JointExport": "kneejax.files._joint_export",
    "export_joint": "kneejax.files._joint_export",
    "JointFile": "kneejax.files._joint_file",
    "format_joint": "kneejax.files._joint_file",
    "read_joint": "kneejax.files._joint_file",
    "write_joint": "kneejax.files._joint_file",
    "KneeFile": "kneejax.files._knee_file",
    "format_knee": "kneejax.files._knee_file",
    "read_knee": "kneejax.files._knee_file",
    "write_knee": "kneejax.files._knee_file",
    "FemurLandmarks": "kneejax.files._landmarks",
    "TibiaLandmarks": "kneejax.files._landmarks",
    "read_femur_landmarks": "kneejax.files._landmarks",
    "read_tibia_landmarks": "kneejax.files._landmarks",
    "THICKNESSES": "kneejax.files._mesh_import",
    "MeshImport": "kneejax.files._mesh_import",
    "import_meshes": "kneejax.files._mesh_import",
    "SheetFit": "kneejax.files._mesh_region",
    "MESH_UNITS": "kneejax.files._meshes",
    "MeshPoints": "kneejax.files._meshes",
    "read_mesh_points": "kneejax.files._meshes",
    "mirror_document": "kneejax.files._mirror",
    "write_netcdf": "kneejax.files._netcdf",
    "SMALLEST_MODEL": "kneejax.files._opensim_example",
    "OsimExport": "kneejax.files._opensim_export",
    "export_osim": "kneejax.files._opensim_export",
    "OsimGeometry": "kneejax.files._opensim_geometry",
    "add_osim_contacts": "kneejax.files._opensim_geometry",
    "OsimImport": "kneejax.files._opensim_import",
    "import_osim": "kneejax.files._opensim_import",
    "format_import_report": "kneejax.files._opensim_report",
    "InputProblem": "kneejax.files._problem",
    "counted": "kneejax.files._problem",
    "nearest_name": "kneejax.files._problem",
    "DEFAULT_BOUNDS": "kneejax.files._study",
    "DEFAULT_WEIGHTS": "kneejax.files._study",
    "METHODS": "kneejax.files._study",
    "PROCEDURES": "kneejax.files._study",
    "Measured": "kneejax.files._study",
    "Study": "kneejax.files._study",
    "Synthetic": "kneejax.files._study",
    "parse_flexion": "kneejax.files._study",
    "read_measured": "kneejax.files._study",
    "read_study": "kneejax.files._study",
    "FEMORAL": "kneejax.files._tables",
    "read_poses": "kneejax.files._tables",
    "write_poses": "kneejax.files._tables",
    "write_rows": "kneejax.files._tables",
    "write_bytes": "kneejax.files._text",
    "write_text": "kneejax.files._text",
}

if TYPE_CHECKING:
    from kneejax.files._bundled import Measurement as Measurement
    from kneejax.files._bundled import absent_measurement as absent_measurement
    from kneejax.files._bundled import bundled_knee_descriptions as bundled_knee_descriptions
    from kneejax.files._bundled import bundled_knees as bundled_knees
    from kneejax.files._bundled import bundled_measurements as bundled_measurements
    from kneejax.files._bundled import bundled_path as bundled_path
    from kneejax.files._bundled import bundled_studies as bundled_studies
    from kneejax.files._bundled import load_knee as load_knee
    from kneejax.files._bundled import load_knee_file as load_knee_file
    from kneejax.files._bundled import study_path as study_path
    from kneejax.files._calibrated import Calibrated as Calibrated
    from kneejax.files._calibrated import read_calibrated as read_calibrated
    from kneejax.files._candidates import CandidateRow as CandidateRow
    from kneejax.files._candidates import read_candidates as read_candidates
    from kneejax.files._checkpoints import Checkpoints as Checkpoints
    from kneejax.files._joint_axes import AxisPoints as AxisPoints
    from kneejax.files._joint_axes import read_axis_points as read_axis_points
    from kneejax.files._joint_axes import write_axis_points as write_axis_points
    from kneejax.files._joint_export import JointExport as JointExport
    from kneejax.files._joint_export import export_joint as export_joint
    from kneejax.files._joint_file import JointFile as JointFile
    from kneejax.files._joint_file import format_joint as format_joint
    from kneejax.files._joint_file import read_joint as read_joint
    from kneejax.files._joint_file import write_joint as write_joint
    from kneejax.files._knee_file import KneeFile as KneeFile
    from kneejax.files._knee_file import format_knee as format_knee
    from kneejax.files._knee_file import read_knee as read_knee
    from kneejax.files._knee_file import write_knee as write_knee
    from kneejax.files._landmarks import FemurLandmarks as FemurLandmarks
    from kneejax.files._landmarks import TibiaLandmarks as TibiaLandmarks
    from kneejax.files._landmarks import read_femur_landmarks as read_femur_landmarks
    from kneejax.files._landmarks import read_tibia_landmarks as read_tibia_landmarks
    from kneejax.files._mesh_import import THICKNESSES as THICKNESSES
    from kneejax.files._mesh_import import MeshImport as MeshImport
    from kneejax.files._mesh_import import import_meshes as import_meshes
    from kneejax.files._mesh_region import SheetFit as SheetFit
    from kneejax.files._meshes import MESH_UNITS as MESH_UNITS
    from kneejax.files._meshes import MeshPoints as MeshPoints
    from kneejax.files._meshes import read_mesh_points as read_mesh_points
    from kneejax.files._mirror import mirror_document as mirror_document
    from kneejax.files._netcdf import write_netcdf as write_netcdf
    from kneejax.files._opensim_example import SMALLEST_MODEL as SMALLEST_MODEL
    from kneejax.files._opensim_export import OsimExport as OsimExport
    from kneejax.files._opensim_export import export_osim as export_osim
    from kneejax.files._opensim_geometry import OsimGeometry as OsimGeometry
    from kneejax.files._opensim_geometry import add_osim_contacts as add_osim_contacts
    from kneejax.files._opensim_import import OsimImport as OsimImport
    from kneejax.files._opensim_import import import_osim as import_osim
    from kneejax.files._opensim_report import format_import_report as format_import_report
    from kneejax.files._problem import InputProblem as InputProblem
    from kneejax.files._problem import counted as counted
    from kneejax.files._problem import nearest_name as nearest_name
    from kneejax.files._study import DEFAULT_BOUNDS as DEFAULT_BOUNDS
    from kneejax.files._study import DEFAULT_WEIGHTS as DEFAULT_WEIGHTS
    from kneejax.files._study import METHODS as METHODS
    from kneejax.files._study import PROCEDURES as PROCEDURES
    from kneejax.files._study import Measured as Measured
    from kneejax.files._study import Study as Study
    from kneejax.files._study import Synthetic as Synthetic
    from kneejax.files._study import parse_flexion as parse_flexion
    from kneejax.files._study import read_measured as read_measured
    from kneejax.files._study import read_study as read_study
    from kneejax.files._tables import FEMORAL as FEMORAL
    from kneejax.files._tables import read_poses as read_poses
    from kneejax.files._tables import write_poses as write_poses
    from kneejax.files._tables import write_rows as write_rows
    from kneejax.files._text import write_bytes as write_bytes
    from kneejax.files._text import write_text as write_text
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
