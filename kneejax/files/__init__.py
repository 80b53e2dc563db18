"""Knee files, studies, tables and meshes: the only rooms that touch a disk."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files._bundled import LaxityBand as LaxityBand
    from kneejax.files._bundled import Measurement as Measurement
    from kneejax.files._bundled import absent_measurement as absent_measurement
    from kneejax.files._bundled import bundled_bands as bundled_bands
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
    from kneejax.files._joint import JointExport as JointExport
    from kneejax.files._joint import JointFile as JointFile
    from kneejax.files._joint import export_joint as export_joint
    from kneejax.files._joint import format_joint as format_joint
    from kneejax.files._joint import read_joint as read_joint
    from kneejax.files._joint import write_joint as write_joint
    from kneejax.files._knees import check_new as check_new
    from kneejax.files._knees import load_knee as load_knee
    from kneejax.files._knees import load_knee_file as load_knee_file
    from kneejax.files._knees import write_calibrated_knee as write_calibrated_knee
    from kneejax.files._landmarks import AxisPoints as AxisPoints
    from kneejax.files._landmarks import read_axis_points as read_axis_points
    from kneejax.files._landmarks import read_femur_landmarks as read_femur_landmarks
    from kneejax.files._landmarks import read_tibia_landmarks as read_tibia_landmarks
    from kneejax.files._landmarks import write_axis_points as write_axis_points
    from kneejax.files.knee.document import format_knee as format_knee
    from kneejax.files.knee.document import mirror_document as mirror_document
    from kneejax.files.knee.file import KneeFile as KneeFile
    from kneejax.files.knee.file import read_knee as read_knee
    from kneejax.files.knee.file import write_knee as write_knee
    from kneejax.files.knee.restated import reconstructed as reconstructed
    from kneejax.files.knee.restated import restated as restated
    from kneejax.files.meshes.importing import MeshImport as MeshImport
    from kneejax.files.meshes.importing import MeshOptions as MeshOptions
    from kneejax.files.meshes.importing import import_meshes as import_meshes
    from kneejax.files.meshes.points import bone_surface as bone_surface
    from kneejax.files.meshes.points import read_mesh_points as read_mesh_points
    from kneejax.files.meshes.soft_tissues import MeshBand as MeshBand
    from kneejax.files.meshes.soft_tissues import MeshMeniscus as MeshMeniscus
    from kneejax.files.meshes.soft_tissues import band_of_meshes as band_of_meshes
    from kneejax.files.meshes.soft_tissues import meniscus_of_mesh as meniscus_of_mesh
    from kneejax.files.opensim.contact import add_osim_contacts as add_osim_contacts
    from kneejax.files.opensim.coupled import couple_model as couple_model
    from kneejax.files.opensim.coupled import coupled_motion as coupled_motion
    from kneejax.files.opensim.export import export_osim as export_osim
    from kneejax.files.opensim.frames import registered as registered
    from kneejax.files.opensim.importing import import_osim as import_osim
    from kneejax.files.opensim.model import SMALLEST_MODEL as SMALLEST_MODEL
    from kneejax.files.opensim.record import read_activity as read_activity
    from kneejax.files.opensim.report import format_import_report as format_import_report
    from kneejax.files.opensim.whole_body import WholeBody as WholeBody
    from kneejax.files.opensim.whole_body import ask_opensim as ask_opensim
    from kneejax.files.opensim.whole_body import whole_body as whole_body
    from kneejax.files.reading import InputProblem as InputProblem
    from kneejax.files.reading import InputProblems as InputProblems
    from kneejax.files.reading import counted as counted
    from kneejax.files.reading import parse_flexion as parse_flexion
    from kneejax.files.reading import parse_range as parse_range
    from kneejax.files.reading import said_of as said_of
    from kneejax.files.reading import write_bytes as write_bytes
    from kneejax.files.reading import write_text as write_text
    from kneejax.files.results import Calibrated as Calibrated
    from kneejax.files.results import Checkpoints as Checkpoints
    from kneejax.files.results import read_calibrated as read_calibrated
    from kneejax.files.results import write_netcdf as write_netcdf
    from kneejax.files.tables.loads import LabTable as LabTable
    from kneejax.files.tables.loads import read_candidates as read_candidates
    from kneejax.files.tables.loads import read_lab_table as read_lab_table
    from kneejax.files.tables.loads import read_loads as read_loads
    from kneejax.files.tables.loads import read_loads_over_time as read_loads_over_time
    from kneejax.files.tables.storage import read_storage as read_storage
    from kneejax.files.tables.tables import read_patella_poses as read_patella_poses
    from kneejax.files.tables.tables import read_poses as read_poses
    from kneejax.files.tables.tables import write_poses as write_poses
    from kneejax.files.tables.tables import write_rows as write_rows
else:
    lazy_imports(globals())
