"""Every command and its options. Nothing heavy is imported: help and mistakes come at once."""

from kneejax.cli.options import joints, knees, simulate, studies

#: Heading of the help -> its commands.
COMMANDS = {
    "Begin": (knees.Knees, knees.Init, knees.Describe),
    "Simulate": (simulate.Simulate, knees.Activity, knees.Evaluate, knees.View, knees.Explore),
    "Identify": (studies.Calibrate, studies.Map, studies.Sensitivity, studies.Identify,
                 studies.CohortSynthesise),
    "Plan and compare": (studies.PlanAcl, joints.JointFit, joints.JointCompare, joints.JointExport,
                         studies.Reproduce),
    "Import and export": (knees.ImportOsim, knees.ImportStl, knees.ImportLigament,
                          knees.ImportMeniscus, knees.ExportOsim),
    "Again": (studies.Rerun, studies.Completion)}  # fmt: skip
#: First word of several commands, or none -> what its help says; the example is the first one's.
ABOVE = {
    "": "Differentiable knee-joint model: simulate, and identify ligaments from measured motion.",
    "joint": "Fit, compare and export simple joints: moving axis and hinge.",
    "import": "Make a knee from a model or from meshes.",
    "export": "Write a knee's numbers into a model.",
    "cohort": "Make up a cohort of knees.",
    "plan": "Plan an operation on a knee."}
#: Of a person who knows no command yet.
EXAMPLE = "kneejax simulate passive-flexion --flexion 0:120:5"
