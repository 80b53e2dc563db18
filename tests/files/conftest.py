"""A complete small knee document, shared by the tests of this room."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.fixture
def knee_document() -> dict[str, Any]:
    """A right knee that uses every kind of surface and every way to give a slack length."""
    return {
        "kneejax": 1,
        "name": "small",
        "side": "right",
        "description": "Two condyles on a plateau and a plane.",
        "reference_pose": {
            "flexion_deg": 5.0, "adduction_deg": 1.5, "internal_rotation_deg": 2.0,
            "anterior_mm": 1.0, "superior_mm": -27.0, "lateral_mm": 2.0, "source": "assumed",
        },
        "ligaments": {
            "ACL": {
                "femoral_attachment_mm": [-8.0, -2.0, 6.5],
                "tibial_attachment_mm": [9.0, 0.0, -1.0],
                "stiffness_N": 4500,
                "reference_strain": 0.03,
                "transition_strain": 0.03,
                "transition_width": 1e-3,
                "source": "paper, Table 1",
            },
            "PCL": {
                "femoral_attachment_mm": [-2.0, -4.0, -7.0],
                "tibial_attachment_mm": [-24.0, -10.0, 1.0],
                "stiffness_N": 9000.0,
                "slack_length_mm": 36.5,
                "transition_strain": 0.03,
                "transition_width": 0.001,
                "source": {
                    "femoral_attachment_mm": "digitised",
                    "tibial_attachment_mm": "digitised",
                    "stiffness_N": "paper",
                    "slack_length_mm": "1e-3",
                    "transition_strain": "paper",
                },
            },
            "MCL": {
                "femoral_attachment_mm": [0.0, 2.0, -44.0],
                "tibial_attachment_mm": [5.0, -60.0, -25.0],
                "stiffness_N": 2750.0,
                "reference_force_N": 20.0,
                "transition_strain": 0.06,
                "transition_width": 0.001,
                "source": "paper, Table 1",
            },
        },
        "contacts": {
            "medial": {
                "form": "elliptical_patch",
                "law": "log",
                "youngs_modulus_MPa": 5,
                "poisson_ratio": 0.45,
                "layer_thickness_mm": 6,
                "onset_width_mm": 0.02,
                "femoral_surface": {
                    "kind": "condyle",
                    "axis_point_mm": [1.0, 2.0, -3.0],
                    "axis_rotation_deg": [2.0, -3.0, 4.0],
                    "angle_deg": [10, 170],
                    "width_mm": [-34.0, -12.0],
                    "coefficients_mm": [[22.0, 0.3, -1.5], [-1.0, 0.2, 0.1], [-0.5, 0.0, 0.05]],
                    "source": "fitted",
                    "fit_rms_mm": 0.2,
                    "fit_max_mm": 0.9,
                },
                "tibial_surface": {
                    "kind": "plateau",
                    "origin_mm": [0.0, 1.0, -2.0],
                    "rotation_deg": [1.0, 2.0, -3.0],
                    "anterior_mm": [-20.0, 18.0],
                    "lateral_mm": [-36.0, -10.0],
                    "coefficients_mm": [[-3.0, 0.4, 1.0], [0.2, 0.1, 0.0]],
                    "source": "fitted",
                },
                "source": "paper",
            },
            "lateral": {
                "form": "quadrature",
                "points": [12, 14],
                "law": "ratio",
                "youngs_modulus_MPa": 5,
                "poisson_ratio": 0.45,
                "layer_thickness_mm": 6,
                "onset_width_mm": 0.02,
                "femoral_surface": {
                    "kind": "ellipsoid",
                    "center_mm": [0.0, 0.0, 24.0],
                    "rotation_deg": [1.0, 2.0, 3.0],
                    "semi_axes_mm": [24.0, 22.0, 18.0],
                    "source": "fitted",
                },
                "tibial_surface": {
                    "kind": "plane",
                    "origin_mm": [0.0, -1.0, 22.0],
                    "rotation_deg": [3.0, 0.0, -6.0],
                    "half_extent_mm": [20.0, 14.0],
                    "source": "fitted",
                },
                "source": "paper",
            },
        },
        "lines": {
            "patellar_tendon": {
                "tension_N": 19.6,
                "insertion_mm": [35.0, -30.0, 3.0],
                "origin_mm": [[45.0, 10.0, 1.0], [-8.0, -20.0, 0.5]],
                "source": "paper",
            }
        },
        "loads": {
            "weight": {
                "force_N": [0.0, 20.0, 1.0],
                "moment_Nmm": [100.0, -200.0, 300.0],
                "point_mm": [0.0, -5.0, 2.0],
                "axes": "tibia",
                "point_in": "tibia",
                "source": "paper",
            }
        },
        "adaptations": [
            {"field": "ligaments.ACL.stiffness_N", "from": 5000, "to": 4500, "reason": "a trial"}
        ],
        "notes": "Only for tests: nobody has this knee.",
    }
