"""Planning a reconstruction of the anterior cruciate ligament: grafts, tunnels, tension."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.planning._followed import Followed as Followed
    from kneejax.planning._followed import Protocol as Protocol
    from kneejax.planning._followed import fix as fix
    from kneejax.planning._followed import fixed_knee as fixed_knee
    from kneejax.planning._followed import follow as follow
    from kneejax.planning._followed import slack_length as slack_length
    from kneejax.planning._footprints import DIRECTIONS as DIRECTIONS
    from kneejax.planning._footprints import FARTHEST_MM as FARTHEST_MM
    from kneejax.planning._footprints import SEMI_AXES_MM as SEMI_AXES_MM
    from kneejax.planning._footprints import WINDOW as WINDOW
    from kneejax.planning._footprints import Footprint as Footprint
    from kneejax.planning._footprints import footprint_of as footprint_of
    from kneejax.planning._footprints import octagon as octagon
    from kneejax.planning._footprints import offsets as offsets
    from kneejax.planning._footprints import warped_distances as warped_distances
    from kneejax.planning._front import GENERATIONS as GENERATIONS
    from kneejax.planning._front import POPULATION as POPULATION
    from kneejax.planning._front import Front as Front
    from kneejax.planning._front import pareto_front as pareto_front
    from kneejax.planning._front import undominated as undominated
    from kneejax.planning._map import Intervals as Intervals
    from kneejax.planning._map import TunnelMap as TunnelMap
    from kneejax.planning._map import intervals as intervals
    from kneejax.planning._map import on_knee as on_knee
    from kneejax.planning._map import tolerances as tolerances
    from kneejax.planning._map import tunnel_map as tunnel_map
    from kneejax.planning._optimum import MOST_EVALUATIONS as MOST_EVALUATIONS
    from kneejax.planning._optimum import STARTS as STARTS
    from kneejax.planning._optimum import Optimum as Optimum
    from kneejax.planning._optimum import optimise as optimise
    from kneejax.planning._plan import FREE as FREE
    from kneejax.planning._plan import PLANNED as PLANNED
    from kneejax.planning._plan import AclPlan as AclPlan
    from kneejax.planning._plan import PlanResult as PlanResult
    from kneejax.planning._plan import intact_knee as intact_knee
    from kneejax.planning._plan import knee_of_outcome as knee_of_outcome
    from kneejax.planning._plan import operated_knees as operated_knees
    from kneejax.planning._plan import run_plan as run_plan
    from kneejax.planning._reconstruction import GRAFTS as GRAFTS
    from kneejax.planning._reconstruction import Reconstruction as Reconstruction
    from kneejax.planning._reconstruction import reconstruction_of as reconstruction_of
    from kneejax.planning._surgery import CHOICES as CHOICES
    from kneejax.planning._surgery import Limits as Limits
    from kneejax.planning._surgery import Near as Near
    from kneejax.planning._surgery import Outcome as Outcome
    from kneejax.planning._surgery import Surgery as Surgery
    from kneejax.planning._surgery import best_of as best_of
    from kneejax.planning._surgery import criteria_of as criteria_of
    from kneejax.planning._surgery import missed as missed
else:
    lazy_imports(globals())
