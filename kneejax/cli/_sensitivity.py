"""`kneejax sensitivity [STUDY.yaml]`: what each parameter does to the motion."""

from __future__ import annotations

import argparse

from kneejax import studies
from kneejax.cli._deliver import deliver
from kneejax.cli._given import read_numbers, read_texts, said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.studies import Sensitivity


def run(arguments: argparse.Namespace) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        from kneejax.cli import _sensitivity_knees

        return _sensitivity_knees.run(arguments)
    with said_of_options(Sensitivity):
        question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(Sensitivity), stages_on_terminal() as progress:
        found = studies.sensitivity(study, question, progress=progress)
    from kneejax.report.sensitivity import sensitivity_answer

    names = {"sweep": "sweep", "scale": "scale", "prior": "prior", "global": "indices",
             "samples": "samples", "range": "ranges", "seed": "seed"}  # fmt: skip
    options = {name: getattr(arguments, field) for name, field in names.items()}
    return deliver(sensitivity_answer(found, options), arguments, seconds=found.seconds)


def _question(arguments: argparse.Namespace) -> Sensitivity:
    swept, priors, ranges = (
        read_texts(option, words)
        for option, words in (
            ("--sweep", arguments.sweep),
            ("--prior", arguments.prior),
            ("--range", arguments.ranges),
        )
    )
    stated = {name: text for name, text in swept.items() if text}
    values = read_numbers("--sweep", stated, "NAME=LOW:HIGH:COUNT", (2, 3))
    # A count is a whole number; what is none is refused as it was given.
    lines = {
        name: (*ends[:2], *(int(n) if n.is_integer() else n for n in ends[2:]))
        for name, ends in values.items()
    }
    widths = read_numbers("--prior", priors, "NAME=SD", (1,))
    return Sensitivity(
        sweep={name: lines.get(name) for name in swept},
        scale=arguments.scale,
        prior={name: width for name, (width,) in widths.items()},
        indices=arguments.indices,
        samples=arguments.samples,
        range=read_numbers("--range", ranges, "NAME=LOW:HIGH", (2,)),
        seed=arguments.seed,
    )
