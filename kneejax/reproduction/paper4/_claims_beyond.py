"""Findings of paper 4 about what these knees and this solver do not have."""

from __future__ import annotations

from kneejax.reproduction._claims import CANNOT_BE_JUDGED, Claim


def _beyond(number: str, statement: str, printed: str, reason: str) -> Claim:
    """A finding about something that this software has not got."""
    return Claim(number, statement, "none", printed, "-", CANNOT_BE_JUDGED, reason)


#: In the order of the paper's sections.
NOT_JUDGED = (
    _beyond(
        "4.16",
        "Convergence of model oks001 is very sensitive to the PCL's attachment.",
        "2 of 3 simulations did not start (3.1.3)",
        "It is about one specimen, whose geometry is not bundled.",
    ),
    _beyond(
        "4.17",
        "The stiffness of the meniscal horns has a small influence.",
        "small on all four outcomes (3.1.4)",
        "These knees have no menisci.",
    ),
    _beyond(
        "4.18",
        "An Augmented Lagrangian has a large influence on the peak pressure.",
        "large; up to 2454 per cent (3.2)",
        "The contact law here is the layer's own: no constraint has to be enforced.",
    ),
    _beyond(
        "4.19",
        "The penalty factor has a large influence on the peak pressure.",
        "large in all models (3.2)",
        "There is no penalty factor; the layer's stiffness is a material property.",
    ),
    _beyond(
        "4.20",
        "Auto penalty and a larger search radius keep models from starting; without two passes, "
        "cartilages overlap without pressure.",
        "in all models (3.2)",
        "These are settings of FEBio's contact search.",
    ),
    _beyond(
        "4.21",
        "BFGS and Broyden updates keep two models from converging and change the others little.",
        "du02 and oks006 (3.3)",
        "These are settings of FEBio's solver; five unknowns need no quasi-Newton updates.",
    ),
    _beyond(
        "4.22",
        "The displacement tolerance has at most a small influence.",
        "small; none in oks001 (3.3)",
        "It is a setting of FEBio's solver; balances here are accurate to 1e-7 mm.",
    ),
    _beyond(
        "4.23",
        "Of the cylindrical joints' settings, the moment penalty stops most models; the others "
        "have small influences, the angular tolerance up to 2 on place.",
        "all but oks003 (3.4)",
        "Loads act on the tibia directly: there are no cylindrical joints.",
    ),
    _beyond(
        "4.24",
        "Ligament properties have to be calibrated; values from the literature may not do.",
        "conclusion (4, 5)",
        "It is advice drawn from 4.1 and 4.2, not a measurement.",
    ),
)
