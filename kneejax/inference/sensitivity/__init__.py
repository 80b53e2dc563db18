"""What a parameter moves: sweeps, slopes, indices, maps."""

from kneejax.inference.sensitivity._global_indices import USUAL_SAMPLES as USUAL_SAMPLES
from kneejax.inference.sensitivity._global_indices import GlobalIndices as GlobalIndices
from kneejax.inference.sensitivity._global_indices import MotionIndices as MotionIndices
from kneejax.inference.sensitivity._global_indices import Output as Output
from kneejax.inference.sensitivity._global_indices import global_indices as global_indices
from kneejax.inference.sensitivity._global_indices import index_ranges as index_ranges
from kneejax.inference.sensitivity._global_indices import motion_indices as motion_indices
from kneejax.inference.sensitivity._map import in_convention as in_convention
from kneejax.inference.sensitivity._map import map_ranges as map_ranges
from kneejax.inference.sensitivity._map import sensitivity_map as sensitivity_map
from kneejax.inference.sensitivity._map import sensitivity_maps as sensitivity_maps
from kneejax.inference.sensitivity._parameter_map import BlockStore as BlockStore
from kneejax.inference.sensitivity._parameter_map import Condition as Condition
from kneejax.inference.sensitivity._parameter_map import ParameterMap as ParameterMap
from kneejax.inference.sensitivity._parameter_map import worst_condition as worst_condition
from kneejax.inference.sensitivity._sweeps import USUAL_COUNT as USUAL_COUNT
from kneejax.inference.sensitivity._sweeps import LocalSensitivity as LocalSensitivity
from kneejax.inference.sensitivity._sweeps import Sweep as Sweep
from kneejax.inference.sensitivity._sweeps import Sweeps as Sweeps
from kneejax.inference.sensitivity._sweeps import local_sensitivity as local_sensitivity
from kneejax.inference.sensitivity._sweeps import step_widths as step_widths
from kneejax.inference.sensitivity._sweeps import sweep as sweep
from kneejax.inference.sensitivity._sweeps import sweep_values as sweep_values
