"""`kneejax describe KNEE`."""

from __future__ import annotations

import argparse

import numpy as np

from kneejax.files import load_knee_file
from kneejax.geometry import COLUMNS
from kneejax.mechanics import Contact, Knee


def run(arguments: argparse.Namespace) -> int:
    """Print a knee: ligaments, contacts, loads, frames, adaptations."""
    knee_file = load_knee_file(arguments.knee)
    knee = knee_file.knee
    print(f"{knee.name} ({knee.side} knee)")
    print(f"  {' '.join(knee_file.description.split())}")
    pose = np.asarray(knee.reference_pose.to_table())
    words = [f"{column} {value:g}" for column, value in zip(COLUMNS, pose, strict=True)]
    print("  reference pose: " + ", ".join(words))
    print("  frames: X anterior, Y superior, Z lateral; tibia in femur; mm, N, MPa")
    _ligaments(knee)
    for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
        _contact(name, contact, knee_file.document["contacts"][name])
    for line in knee.lines:
        print(f"\nLine {line.name}: {float(line.tension):g} N")
    for load in knee.loads:
        print(f"\nLoad {load.name}: {np.asarray(load.force)} N in {load.axes} axes")
    for change in knee_file.adaptations:
        print(f"\nAdapted {change['field']}")
        for key in ("from", "to", "reason"):
            print(f"  {key}: {' '.join(str(change[key]).split())}")
    return 0


def _ligaments(knee: Knee) -> None:
    print("\nLigament   stiffness_N  reference_strain  reference_length_mm  slack_length_mm")
    rows = zip(
        knee.ligaments.names,
        np.asarray(knee.ligaments.stiffness),
        np.asarray(knee.reference_strain()),
        np.asarray(knee.reference_length()),
        np.asarray(knee.ligaments.slack_length),
        strict=True,
    )
    for name, stiffness, strain, reference, slack in rows:
        print(f"{name:<10} {stiffness:>11.0f}  {strain:>16.4f}  {reference:>19.3f}  {slack:>15.3f}")


def _contact(name: str, contact: Contact, document: dict) -> None:
    print(f"\nContact {name}: {contact.form.replace('_', ' ')}, {contact.law} law")
    print(
        f"  E {float(contact.youngs_modulus):g} MPa, nu {float(contact.poisson_ratio):g}, "
        f"confined modulus {float(contact.modulus):.3f} MPa, "
        f"layer {float(contact.layer_thickness):g} mm"
    )
    for side in ("femoral_surface", "tibial_surface"):
        surface = document[side]
        fit = ""
        if "fit_rms_mm" in surface:
            fit = f", fit {surface['fit_rms_mm']:g} mm rms, {surface['fit_max_mm']:g} mm at most"
        print(f"  {side.replace('_', ' ')}: {surface['kind']}{fit}")
