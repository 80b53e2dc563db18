"""Every command and its options. Nothing heavy is imported: help and mistakes come at once."""

from kneejax.cli.options._joints import JointCompare as JointCompare
from kneejax.cli.options._joints import JointExport as JointExport
from kneejax.cli.options._joints import JointFit as JointFit
from kneejax.cli.options._knees import Activity as Activity
from kneejax.cli.options._knees import Describe as Describe
from kneejax.cli.options._knees import Evaluate as Evaluate
from kneejax.cli.options._knees import Explore as Explore
from kneejax.cli.options._knees import ExportOsim as ExportOsim
from kneejax.cli.options._knees import ImportLigament as ImportLigament
from kneejax.cli.options._knees import ImportMeniscus as ImportMeniscus
from kneejax.cli.options._knees import ImportOsim as ImportOsim
from kneejax.cli.options._knees import ImportStl as ImportStl
from kneejax.cli.options._knees import Init as Init
from kneejax.cli.options._knees import Knees as Knees
from kneejax.cli.options._knees import View as View
from kneejax.cli.options._simulate import EXTENSOR as EXTENSOR
from kneejax.cli.options._simulate import TESTS as TESTS
from kneejax.cli.options._simulate import Simulate as Simulate
from kneejax.cli.options._studies import Calibrate as Calibrate
from kneejax.cli.options._studies import CohortSynthesise as CohortSynthesise
from kneejax.cli.options._studies import Completion as Completion
from kneejax.cli.options._studies import Identify as Identify
from kneejax.cli.options._studies import Map as Map
from kneejax.cli.options._studies import PlanAcl as PlanAcl
from kneejax.cli.options._studies import Reproduce as Reproduce
from kneejax.cli.options._studies import Rerun as Rerun
from kneejax.cli.options._studies import Sensitivity as Sensitivity

#: Heading of the help -> its commands.
COMMANDS = {
    "Begin": (Knees, Init, Describe),
    "Simulate": (Simulate, Activity, Evaluate, View, Explore),
    "Identify": (Calibrate, Map, Sensitivity, Identify, CohortSynthesise),
    "Plan and compare": (PlanAcl, JointFit, JointCompare, JointExport, Reproduce),
    "Import and export": (ImportOsim, ImportStl, ImportLigament, ImportMeniscus, ExportOsim),
    "Again": (Rerun, Completion),
}
#: First word of several commands, or none -> what its help says; the example is the first one's.
ABOVE = {
    "": "Differentiable knee-joint model: simulate, and identify ligaments from measured motion.",
    "joint": "Fit, compare and export simple joints: moving axis and hinge.",
    "import": "Make a knee from a model or from meshes.",
    "export": "Write a knee's numbers into a model.",
    "cohort": "Make up a cohort of knees.",
    "plan": "Plan an operation on a knee.",
}
#: Of a person who knows no command yet.
EXAMPLE = "kneejax simulate passive-flexion --flexion 0:120:5"
