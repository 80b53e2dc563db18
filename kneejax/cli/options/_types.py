"""Types of options that several commands have."""

from pathlib import Path
from typing import Annotated, Literal

from kneejax.cli._command import Bundled, File, Form, Group, Parameters

#: As `kneejax.geometry.CONVENTIONS`, which would bring in JAX.
Convention = Literal["femoral", "grood-suntay", "tibial", "femur-in-tibia"]
#: What stands for a knee, wherever one is expected.
KNEE = "bundled name, knee file, or the result.json of a calibration"
Knee = Annotated[str, Bundled("knees")]
Table = Annotated[Path, File("a CSV table")]
Mesh = Annotated[Path, File("a triangle mesh")]
#: Parameters set by name.
Values = Annotated[dict[str, float], Form("NAME=VALUE"), Group("Knee"), Parameters()]
SET = (
    "a parameter, as ACL.stiffness=3000 (N) or *.reference_strain=0.02; once for each. By the name "
    "of a structure drawn as several fibres (a group), stiffness is the sum over its fibres, any "
    "other number their mean")
