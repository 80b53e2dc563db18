"""Words and tables of docs/validation_lenhart2015.md on equilibrium."""

from __future__ import annotations

import numpy as np

from kneejax import Status

_COORDINATES = (
    "adduction", "internal rotation", "anterior translation", "superior translation",
    "lateral translation",
)  # fmt: skip


def counts_of(results: dict) -> dict:
    """Poses that were found again, and those of which nobody says why not."""
    stand = results["standing"]
    first, held = stand["dead"]["searches"][0], stand["dead"]["footing"].holds
    said = (first.status == Status.NOT_CONVERGED) | (first.status == Status.UNSTABLE)
    return {
        "all": len(held),
        "dead_back": int(first.back.sum()),
        "tendon_back": int(stand["tendon"]["searches"][0].back.sum()),
        "unsaid": int((~first.back & ~said & held).sum()),
        "loose": int((~held).sum()),
    }


def equilibrium(results: dict) -> str:
    """The section on equilibrium."""
    stand, record, counts = results["standing"], results["record"], counts_of(results)
    (turned, moved), (start_deg, start_mm) = stand["limits"], stand["start"]
    footing, load, first = (
        stand["dead"]["footing"], stand["dead"]["load"], stand["dead"]["searches"][0]
    )  # fmt: skip
    held, back, stiffness = footing.holds, first.back, footing.eigenvalues[:, 0]
    unstable, loose, away = (record.flexion[x] for x in (stiffness <= 0, ~held, ~back))
    drift = [np.median(x[held]) for x in footing.drift]
    return f"""## Free to find its equilibrium

The recorded leg has muscles, a patella, an iliotibial band and gravity; ligaments and contact alone
do not stand where it stood. At each instant the force and moment that ligaments and recorded
contact leave unbalanced ({load.min():.0f} to {load.max():.0f} N) are put on the tibia. Flexion is
prescribed, the search begins {start_mm:g} mm and {start_deg:g} degrees away in a direction drawn at
random, and has to come back within {moved:g} mm and {turned:g} degrees. (Fibres were recorded at
{len(results["fibres"].rows)} instants; between these their forces are computed at the recorded
pose, which the comparison above allows.)

### All of it as a dead load

A dead load keeps its direction in the femur. {counts["dead_back"]} of {counts["all"]} poses are
found again, typically to {np.median(first.turned[back]):.2f} degrees and
{np.median(first.moved[back]):.3f} mm. The others lie from {away.min():.1f} to {away.max():.1f}
degrees of flexion.

Whether a pose *can* be found again shows before anything is searched. The stiffness at the recorded
pose (a turn counted as the way of a point {stand["arm_mm"]:g} mm from the axis) must be positive:
at {len(unstable)} poses from {unstable.min():.1f} to {unstable.max():.1f} degrees it is not, down
to {stiffness.min():.1f} N/mm. And the small error of our contact, divided by that stiffness, must
be a small way: where a pose resists with a fraction of a N/mm, an error of one newton is
millimetres. A pose is called *held* where the stiffness is positive and that way is within the
criterion.
{counts["loose"]} poses are not, from {loose.min():.1f} to {loose.max():.1f} degrees. For the others
the way is {drift[0]:.2f} degrees and {drift[1]:.3f} mm (median), which is what the searches find.

{_by_flexion(results)}

*First direction of {len(stand["dead"]["searches"])}. `not_converged` is what kneejax says itself.
Where it balances elsewhere it has found another stable pose, and cannot know that a different one
was meant; whether such poses were held by their own stiffness is the column after it. Where a pose
that is not held ends depends on the last digits of the arithmetic.*

{_tendon(results)}

### From other directions, and with more patience

{_tries(results)}

The last row has {stand["patient_steps"]} steps instead of the usual {stand["usual_steps"]}: where a
held pose is not back, and `not_converged` says so, the number of steps is the reason rather than
another balance."""


def _tendon(results: dict) -> str:
    stand, counts = results["standing"], counts_of(results)
    dead, line, elastic = stand["smallest"].values()
    softest = stand["dead"]["footing"].softest[int(dead.argmin())]
    ways = sorted(zip(abs(softest), _COORDINATES, strict=True), reverse=True)[:2]
    rest, direction = stand["tendon"]["load"], np.median((line - dead) / (elastic - dead))
    return f"""### Why: a tendon's pull turns with the tibia

The direction in which the softest pose gives way is mostly {ways[0][1]} and {ways[1][1]}
({ways[0][0]:.2f} and {ways[1][0]:.2f} of a unit vector). A large part of the missing force is the
patellar tendon's, and a tendon is no dead load: as the tibia moves, its pull keeps pointing at the
patella, and its length changes. To see whether this is the stiffness that is missing, the model's
{stand["fibres"]} tendon fibres are put back, from the tibia to where the patella was recorded at
that instant; only the rest of the wrench ({rest.min():.0f} to {rest.max():.0f} N) stays a dead
load.
At the recorded poses the forces are the same as before; nothing is fitted.

![Stiffness at recorded poses and where searches end](figures/validation_equilibrium.png)

*Left: smallest stiffness at the recorded pose, with the tendon's pull as part of a dead load, as a
line of constant tension, and as elastic fibres. Right: how far from the recorded pose the searches
end, with the dead load and with elastic fibres; crosses on top are searches that did not converge.
Dashed: the criterion. Shaded: the poses that the dead load does not hold.*

With the tendon, {counts["tendon_back"]} of {counts["all"]} poses are found again, and the smallest
stiffness is {elastic.min():.1f} N/mm. Of what the tendon adds to the smallest stiffness,
{100 * direction:.0f} % (median) is its direction: fibres that pulled with their recorded force
whatever their length would leave {line.min():.2f} N/mm at the softest pose and be stable at
{int((line > 0).sum())} of {counts["all"]}. The patella stands still here while the tibia moves; one
that follows holds the knee less firmly."""


def _by_flexion(results: dict) -> str:
    stand, flexion = results["standing"], results["record"].flexion
    held, first = stand["dead"]["footing"].holds, stand["dead"]["searches"][0]
    dead, _, elastic = stand["smallest"].values()
    lost, last = first.status == Status.NOT_CONVERGED, stand["bands"][-1][1]
    rows = []
    for low, high in stand["bands"]:
        here = (flexion >= low - 1e-6) & ((flexion < high) | (high == last))
        counted = (
            here, held, first.back, lost, first.elsewhere, first.elsewhere & held
        )  # fmt: skip
        with_tendon = (here & stand["tendon"]["searches"][0].back).sum()
        rows.append(
            (f"{low} to {high}", *((here & x).sum() for x in counted), f"{dead[here].min():.1f}",
             with_tendon, f"{elastic[here].min():.1f}")
        )  # fmt: skip
    head = (
        "flexion, degrees", "poses", "held", "back", "`not_converged`", "balanced elsewhere",
        "of these, held", "smallest stiffness N/mm", "with tendon: back",
        "smallest stiffness N/mm",
    )  # fmt: skip
    return table_of(head, rows)


def _tries(results: dict) -> str:
    stand = results["standing"]
    held, dead, tendon = stand["dead"]["footing"].holds, stand["dead"], stand["tendon"]
    pairs = list(zip(dead["searches"], tendon["searches"], strict=True))
    named = [(f"direction {k + 1}", *pair) for k, pair in enumerate(pairs)]
    patient = f"direction 1, {stand['patient_steps']} steps"
    head = (
        "start", "dead load: back", "held, yet `not_converged`", "held, yet elsewhere",
        "with tendon: back", "farthest, degrees", "farthest, mm",
    )  # fmt: skip
    rows = [
        (
            name, a.back.sum(), (held & (a.status == Status.NOT_CONVERGED)).sum(),
            (held & a.elsewhere).sum(), b.back.sum(),
            f"{np.nanmax(b.turned):.3f}", f"{np.nanmax(b.moved):.3f}",
        )
        for name, a, b in (*named, (patient, dead["patient"], tendon["patient"]))
    ]  # fmt: skip
    return table_of(head, rows)


def table_of(head, rows) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
