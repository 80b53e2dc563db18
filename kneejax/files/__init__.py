"""Knee files, studies, tables and meshes: the only rooms that touch a disk."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: what is bundled, and what a mistake is called, is said without JAX.
_MODULES = {
    "LaxityBand": "kneejax.files._laxity_bands",
    "bundled_bands": "kneejax.files._laxity_bands",
    "Measurement": "kneejax.files._bundled",
    "absent_measurement": "kneejax.files._bundled",
    "bundled_examples": "kneejax.files._bundled",
    "bundled_files": "kneejax.files._bundled",
    "bundled_knee_descriptions": "kneejax.files._bundled",
    "bundled_knees": "kneejax.files._bundled",
    "bundled_laxity_sources": "kneejax.files._bundled",
    "bundled_measurements": "kneejax.files._bundled",
    "bundled_path": "kneejax.files._bundled",
    "bundled_studies": "kneejax.files._bundled",
    "named_document": "kneejax.files._bundled",
    "named_path": "kneejax.files._bundled",
    "study_path": "kneejax.files._bundled",
    "parse_flexion": "kneejax.files._flexion",
    "parse_range": "kneejax.files._flexion",
    "check_new": "kneejax.files._knees",
    "load_knee": "kneejax.files._knees",
    "load_knee_file": "kneejax.files._knees",
    "write_calibrated_knee": "kneejax.files._knees",
    "knee_with": "kneejax.files._named_values",
    "said_of": "kneejax.files._named_values",
    "AxisPoints": "kneejax.files.joint",
    "FemurLandmarks": "kneejax.files.joint",
    "JointExport": "kneejax.files.joint",
    "JointFile": "kneejax.files.joint",
    "TibiaLandmarks": "kneejax.files.joint",
    "export_joint": "kneejax.files.joint",
    "format_joint": "kneejax.files.joint",
    "read_axis_points": "kneejax.files.joint",
    "read_femur_landmarks": "kneejax.files.joint",
    "read_joint": "kneejax.files.joint",
    "read_tibia_landmarks": "kneejax.files.joint",
    "write_axis_points": "kneejax.files.joint",
    "write_joint": "kneejax.files.joint",
    "KneeFile": "kneejax.files.knee",
    "format_knee": "kneejax.files.knee",
    "mirror_document": "kneejax.files.knee",
    "read_knee": "kneejax.files.knee",
    "reconstructed": "kneejax.files.knee",
    "restated": "kneejax.files.knee",
    "write_knee": "kneejax.files.knee",
    "MESH_UNITS": "kneejax.files.meshes",
    "THICKNESSES": "kneejax.files.meshes",
    "MeshImport": "kneejax.files.meshes",
    "MeshOptions": "kneejax.files.meshes",
    "MeshPoints": "kneejax.files.meshes",
    "SheetFit": "kneejax.files.meshes",
    "bone_surface": "kneejax.files.meshes",
    "import_meshes": "kneejax.files.meshes",
    "read_mesh_points": "kneejax.files.meshes",
    "SMALLEST_MODEL": "kneejax.files.opensim",
    "CoupledMotion": "kneejax.files.opensim",
    "Registration": "kneejax.files.opensim",
    "registered": "kneejax.files.opensim",
    "couple_model": "kneejax.files.opensim",
    "WholeBody": "kneejax.files.opensim",
    "WholeBodyForces": "kneejax.files.opensim",
    "whole_body": "kneejax.files.opensim",
    "ask_opensim": "kneejax.files.opensim",
    "OsimExport": "kneejax.files.opensim",
    "OsimGeometry": "kneejax.files.opensim",
    "OsimImport": "kneejax.files.opensim",
    "add_osim_contacts": "kneejax.files.opensim",
    "coupled_motion": "kneejax.files.opensim",
    "export_osim": "kneejax.files.opensim",
    "format_import_report": "kneejax.files.opensim",
    "import_osim": "kneejax.files.opensim",
    "read_activity": "kneejax.files.opensim",
    "InputProblem": "kneejax.files.reading",
    "InputProblems": "kneejax.files.reading",
    "counted": "kneejax.files.reading",
    "nearest_name": "kneejax.files.reading",
    "write_bytes": "kneejax.files.reading",
    "write_text": "kneejax.files.reading",
    "Calibrated": "kneejax.files.results",
    "Checkpoints": "kneejax.files.results",
    "read_calibrated": "kneejax.files.results",
    "write_netcdf": "kneejax.files.results",
    "CandidateRow": "kneejax.files.tables",
    "read_candidates": "kneejax.files.tables",
    "LabTable": "kneejax.files.tables",
    "read_lab_table": "kneejax.files.tables",
    "read_storage": "kneejax.files.tables",
    "read_loads": "kneejax.files.tables",
    "read_loads_over_time": "kneejax.files.tables",
    "read_patella_poses": "kneejax.files.tables",
    "read_poses": "kneejax.files.tables",
    "write_poses": "kneejax.files.tables",
    "write_rows": "kneejax.files.tables",
}

if TYPE_CHECKING:
    from kneejax.files._bundled import Measurement as Measurement
    from kneejax.files._bundled import absent_measurement as absent_measurement
    from kneejax.files._bundled import bundled_examples as bundled_examples
    from kneejax.files._bundled import bundled_files as bundled_files
    from kneejax.files._bundled import bundled_knee_descriptions as bundled_knee_descriptions
    from kneejax.files._bundled import bundled_knees as bundled_knees
    from kneejax.files._bundled import bundled_laxity_sources as bundled_laxity_sources
    from kneejax.files._bundled import bundled_measurements as bundled_measurements
    from kneejax.files._bundled import bundled_path as bundled_path
    from kneejax.files._bundled import bundled_studies as bundled_studies
    from kneejax.files._bundled import named_document as named_document
    from kneejax.files._bundled import named_path as named_path
    from kneejax.files._bundled import study_path as study_path
    from kneejax.files._flexion import parse_flexion as parse_flexion
    from kneejax.files._flexion import parse_range as parse_range
    from kneejax.files._knees import check_new as check_new
    from kneejax.files._knees import load_knee as load_knee
    from kneejax.files._knees import load_knee_file as load_knee_file
    from kneejax.files._knees import write_calibrated_knee as write_calibrated_knee
    from kneejax.files._laxity_bands import LaxityBand as LaxityBand
    from kneejax.files._laxity_bands import bundled_bands as bundled_bands
    from kneejax.files._named_values import knee_with as knee_with
    from kneejax.files._named_values import said_of as said_of
    from kneejax.files.joint import AxisPoints as AxisPoints
    from kneejax.files.joint import FemurLandmarks as FemurLandmarks
    from kneejax.files.joint import JointExport as JointExport
    from kneejax.files.joint import JointFile as JointFile
    from kneejax.files.joint import TibiaLandmarks as TibiaLandmarks
    from kneejax.files.joint import export_joint as export_joint
    from kneejax.files.joint import format_joint as format_joint
    from kneejax.files.joint import read_axis_points as read_axis_points
    from kneejax.files.joint import read_femur_landmarks as read_femur_landmarks
    from kneejax.files.joint import read_joint as read_joint
    from kneejax.files.joint import read_tibia_landmarks as read_tibia_landmarks
    from kneejax.files.joint import write_axis_points as write_axis_points
    from kneejax.files.joint import write_joint as write_joint
    from kneejax.files.knee import KneeFile as KneeFile
    from kneejax.files.knee import format_knee as format_knee
    from kneejax.files.knee import mirror_document as mirror_document
    from kneejax.files.knee import read_knee as read_knee
    from kneejax.files.knee import reconstructed as reconstructed
    from kneejax.files.knee import restated as restated
    from kneejax.files.knee import write_knee as write_knee
    from kneejax.files.meshes import MESH_UNITS as MESH_UNITS
    from kneejax.files.meshes import THICKNESSES as THICKNESSES
    from kneejax.files.meshes import MeshImport as MeshImport
    from kneejax.files.meshes import MeshOptions as MeshOptions
    from kneejax.files.meshes import MeshPoints as MeshPoints
    from kneejax.files.meshes import SheetFit as SheetFit
    from kneejax.files.meshes import bone_surface as bone_surface
    from kneejax.files.meshes import import_meshes as import_meshes
    from kneejax.files.meshes import read_mesh_points as read_mesh_points
    from kneejax.files.opensim import SMALLEST_MODEL as SMALLEST_MODEL
    from kneejax.files.opensim import CoupledMotion as CoupledMotion
    from kneejax.files.opensim import OsimExport as OsimExport
    from kneejax.files.opensim import OsimGeometry as OsimGeometry
    from kneejax.files.opensim import OsimImport as OsimImport
    from kneejax.files.opensim import Registration as Registration
    from kneejax.files.opensim import WholeBody as WholeBody
    from kneejax.files.opensim import WholeBodyForces as WholeBodyForces
    from kneejax.files.opensim import add_osim_contacts as add_osim_contacts
    from kneejax.files.opensim import ask_opensim as ask_opensim
    from kneejax.files.opensim import couple_model as couple_model
    from kneejax.files.opensim import coupled_motion as coupled_motion
    from kneejax.files.opensim import export_osim as export_osim
    from kneejax.files.opensim import format_import_report as format_import_report
    from kneejax.files.opensim import import_osim as import_osim
    from kneejax.files.opensim import read_activity as read_activity
    from kneejax.files.opensim import registered as registered
    from kneejax.files.opensim import whole_body as whole_body
    from kneejax.files.reading import InputProblem as InputProblem
    from kneejax.files.reading import InputProblems as InputProblems
    from kneejax.files.reading import counted as counted
    from kneejax.files.reading import nearest_name as nearest_name
    from kneejax.files.reading import write_bytes as write_bytes
    from kneejax.files.reading import write_text as write_text
    from kneejax.files.results import Calibrated as Calibrated
    from kneejax.files.results import Checkpoints as Checkpoints
    from kneejax.files.results import read_calibrated as read_calibrated
    from kneejax.files.results import write_netcdf as write_netcdf
    from kneejax.files.tables import CandidateRow as CandidateRow
    from kneejax.files.tables import LabTable as LabTable
    from kneejax.files.tables import read_candidates as read_candidates
    from kneejax.files.tables import read_lab_table as read_lab_table
    from kneejax.files.tables import read_loads as read_loads
    from kneejax.files.tables import read_loads_over_time as read_loads_over_time
    from kneejax.files.tables import read_patella_poses as read_patella_poses
    from kneejax.files.tables import read_poses as read_poses
    from kneejax.files.tables import read_storage as read_storage
    from kneejax.files.tables import write_poses as write_poses
    from kneejax.files.tables import write_rows as write_rows
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
