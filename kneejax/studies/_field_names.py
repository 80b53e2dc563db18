"""Names that a study file may hold: known without JAX, since mistakes are answered at once."""

REQUIRED = ("title", "knee", "parameters")
#: Fields that a study takes as they are.
AS_THEY_ARE = (
    "start", "bounds", "weights", "prior", "procedures", "stages", "starts", "seed", "noise_mm",
    "noise_deg", "frame_offset", "method", "failures", "loads",
)  # fmt: skip
OPTIONAL = ("measured", "synthetic", "tests", "patella", *AS_THEY_ARE, "flexion_deg", "set")
#: All of them.
STUDY_FIELDS = (*REQUIRED, *OPTIONAL)
