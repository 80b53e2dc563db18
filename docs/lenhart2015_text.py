"""Words and tables of docs/validation_lenhart2015.md; every number comes from the results."""

from __future__ import annotations

import textwrap

import numpy as np
from lenhart2015_equilibrium_text import counts_of, equilibrium, table_of


def page(results: dict) -> str:
    """The page, from what `make_lenhart2015_validation.py` found."""
    parts = (_opening, _short, _fibres, _contact, _points, equilibrium, _twin, _limits, _made)
    blocks = "\n\n".join(part(results) for part in parts).split("\n\n")
    return "\n\n".join(_filled(block) for block in blocks) + "\n"


def _filled(block: str) -> str:
    """A paragraph, or the items of a list, in lines of one width; anything else as it is."""
    if block[0] in "|!#":
        return block
    items = block.split("\n- ") if block.startswith("- ") else [block]
    indent = "  " if block.startswith("- ") else ""
    return "\n".join(
        textwrap.fill(
            ("- " if k else "") + " ".join(item.split()), 100, subsequent_indent=indent,
            break_long_words=False, break_on_hyphens=False,
        )
        for k, item in enumerate(items)
    )  # fmt: skip


def _opening(results: dict) -> str:
    record = results["record"]
    return f"""# A published knee, compared with another program

The public lenhart2015 model of OpenSim JAM (Lenhart, Kaiser, Smith and Thelen, Annals of Biomedical
Engineering 43, 2015; Apache-2.0) is one healthy adult's right leg with
{len(results["fibres"].names)} tibiofemoral ligament fibres, wrap objects and cartilage meshes. With
it comes a recorded simulation: passive flexion from {abs(record.flexion[0]):.0f} to
{record.flexion[-1]:.0f} degrees, {len(record.time)} instants once the start has settled.

Here `kneejax import osim` reads that model and its meshes, and what comes out is compared with the
record part by part: first at the recorded poses, where nothing is solved, then free to find its
equilibrium. The record is itself computed. Agreement says that two programs make the same mechanics
of the same files; it does not say that a living knee does the same.

Everything below is made by `python docs/make_lenhart2015_validation.py`: no number is typed
in."""


def _short(results: dict) -> str:
    fibres, contact, stand = results["fibres"], results["contact"], results["standing"]
    bent, errors = fibres.has_obstacle, contact.errors
    length, force = abs(fibres.length_error), abs(fibres.force_error)
    limits, rays = results["criteria"], max(row["rays_error"] for row in results["rays"])
    counts = counts_of(results)
    rows = [
        ("fibres without a wrap object: length", "0.001 mm", f"{_e(length[~bent].max())} mm",
         length[~bent].max() <= 1e-3),
        ("their force", "0.01 N", f"{_e(force[~bent].max())} N", force[~bent].max() <= 0.01),
        ("fibres with a wrap object: length", "0.1 mm", f"{_e(length[bent].max())} mm",
         length[bent].max() <= 0.1),
        ("their force", "2 % or 0.5 N", f"{_e(force[bent].max())} N", fibres.within[bent].all()),
        *(
            (name, _limit(key, limits[key]), _limit(key, abs(errors[key]).max(), 2),
             abs(errors[key]).max() <= limits[key])
            for key, name in _QUANTITIES.items()
        ),
        ("the reference itself: rays between the meshes", "1 %", f"{_e(100 * rays)} %",
         rays <= 0.01),
        (f"equilibrium from {stand['start'][1]:g} mm and {stand['start'][0]:g} degrees away, "
         "patellar tendon as fibres",
         "back within 0.5 mm and 0.5 degrees", f"{counts['tendon_back']} of {counts['all']} poses",
         counts["tendon_back"] == counts["all"]),
        ("the same, all of the missing wrench as a dead load", "back, or it is said why not",
         f"{counts['dead_back']} back; {counts['unsaid']} of the others unexplained",
         counts["unsaid"] == 0),
    ]  # fmt: skip
    table = table_of(
        ("what", "criterion", "worst found", "met"),
        [(*row[:3], "yes" if row[3] else "**no**") for row in rows],
    )
    return f"## Summary\n\n{table}"


_QUANTITIES = {
    "force": "contact force",
    "area": "contact area",
    "max_pressure": "largest contact pressure",
    "center": "centre of pressure",
}


def _fibres(results: dict) -> str:
    fibres = results["fibres"]
    length, force = abs(fibres.length_error), abs(fibres.force_error)
    rows = []
    for name, of in results["bundles"].items():
        obstacles = sorted({fibres.obstacles[row] for row in of} - {""})
        rows.append(
            (
                name, len(of), ", ".join(obstacles) or "-",
                f"{fibres.wrapped[of].sum()} of {fibres.wrapped[of].size}",
                *(_e(f(length[of])) for f in (np.median, np.max)),
                *(_e(f(force[of])) for f in (np.median, np.max)),
                f"{fibres.recorded_force[of].sum(axis=0).max():.0f}",
            )
        )  # fmt: skip
    table = table_of(
        (
            "bundle", "fibres", "wrap object", "samples on it", "length mm, median", "worst",
            "force N, median", "worst", "bundle's largest force N",
        ),
        rows,
    )  # fmt: skip
    wrapped, bent = fibres.wrapped, fibres.has_obstacle
    shorter = (fibres.length_error < 0)[wrapped]
    width = float(np.max(np.asarray(results["knee"].ligaments.transition_width)))
    return f"""## Ligament fibres at recorded poses

Fibres were recorded at {len(fibres.rows)} instants: {length.size} samples,
{int(wrapped.sum())} of them on a wrap object.

{table}

![Force of ten bundles over flexion](figures/validation_fibres.png)

*Force of each bundle at recorded poses: kneejax at every instant, the record where it has fibres.*

Where nothing is in the way, {_e(length[~bent].max())} mm is what the record's own digits leave:
its lengths end at 0.00001 mm, its poses at the sixth digit. The forces'
{_e(force[~bent].max())} N also hold the rounding of the law's corners ({width:g} of strain), which
kneejax has and OpenSim has not. Around wrap objects kneejax takes the shortest way. OpenSim lays
the way over an ellipsoid in a plane that it chooses by a rule, which makes it longer, and adds up
chords, which makes it shorter: of the samples on an object {int(shorter.sum())} of
{int(wrapped.sum())} are shorter here, and none differs by more than {_e(length[wrapped].max())} mm.
A fibre that begins inside its object runs straight in both programs."""


def _contact(results: dict) -> str:
    compared, record, limits = results["contact"], results["record"], results["criteria"]
    rows = []
    for key, name in _QUANTITIES.items():
        error = compared.errors[key]
        worst = int(abs(error).argmax())
        rows.append(
            (
                name, _limit(key, limits[key]), _limit(key, np.median(abs(error)), 2),
                _limit(key, np.mean(error), 2, sign=key != "center"),
                _limit(key, error[worst], 2, sign=key != "center"),
                f"{abs(record.flexion[worst]):.0f}",
            )
        )  # fmt: skip
    table = table_of(
        ("quantity", "criterion", "median", "mean", "worst", "at flexion, degrees"), rows
    )
    fits = table_of(
        ("compartment", "condyle, rms mm", "plateau, rms mm", "points of the sum"),
        [
            (
                name,
                f"{part['femoral_surface']['fit_rms_mm']:.3f}",
                f"{part['tibial_surface']['fit_rms_mm']:.3f}",
                " x ".join(map(str, part["points"])),
            )
            for name, part in results["document"]["contacts"].items()
        ],
    )
    rays = table_of(
        (
            "flexion, degrees", "recorded N", "rays N", "kneejax N",
            "rays off by", "kneejax off by",
        ),
        [
            (
                f"{abs(row['flexion']):.1f}",
                *(f"{row[k]:.1f}" for k in ("recorded", "rays", "ours")),
                f"{_e(100 * row['rays_error'])} %", f"{_e(100 * row['ours_error'])} %",
            )
            for row in results["rays"]
        ],
    )  # fmt: skip
    usable = int(compared.usable.sum())
    return f"""## Contact at recorded poses

The same law, Young's modulus, Poisson ratio and thickness, all read from the model, at all
{len(record.time)} instants; {usable} of them lie within the fitted surfaces and the layer. Forces
run from {compared.recorded_force.min():.0f} to {compared.recorded_force.max():.0f} N.

{table}

![Contact over flexion](figures/validation_contact.png)

*Contact of both compartments together. The band is the criterion around the record.*

JAM sends a ray from each triangle of the tibial mesh; kneejax fits smooth surfaces to both meshes
and sums over points of the plateau. What differs is what smoothing takes away:

{fits}

At depths of about a millimetre, a few hundredths of a millimetre of surface are a few percent of
depth and hence of force. The largest pressure is that of a single triangle in the record; single
bumps of a mesh are what a fit levels out, and the mean of its error, above, shows it. The area
jumps by a whole point or a whole triangle at the rim, where there is hardly any pressure.

Is the record itself understood? A foundation of rays between the meshes, written with NumPy and
SciPy alone and sharing no line with kneejax (`tests/mechanics/raycast_foundation.py`), gives the
recorded force vectors:

{rays}

"Off by" is the length of the difference of the force vectors over the recorded force. So what is
left between kneejax and the record is the surfaces, not the law, the pose or the frames."""


def _points(results: dict) -> str:
    finest = results["points"][-1]["compared"]
    rows = []
    for entry in results["points"]:
        compared = entry["compared"]
        errors = compared.errors
        rows.append(
            (
                ", ".join(f"{a} x {b}" for a, b in entry["points"]),
                *(_limit(k, abs(errors[k]).max(), 2) for k in _QUANTITIES),
                f"{_e(100 * abs(compared.force / finest.force - 1.0).max())} %"
                if compared is not finest else "-",
            )
        )  # fmt: skip
    names = [f"{name}, worst" for name in _QUANTITIES.values()]
    table = table_of(("points", *names, "force against the last row"), rows)
    return f"""### How many points

The same contact with fewer and with more points, at every eighth instant:

{table}

The importer's own number is in the second row. Once the force no longer changes, what stays is the
difference of the surfaces. An area that comes in whole points gains most from more of them."""


def _twin(results: dict) -> str:
    twin, limits = results["twin"], results["criteria"]
    errors = twin["compared"].errors
    table = table_of(
        ("quantity", "criterion", "median", "worst"),
        [
            (name, _limit(k, limits[k]), _limit(k, np.median(abs(errors[k])), 2),
             _limit(k, abs(errors[k]).max(), 2))
            for k, name in _QUANTITIES.items()
        ],
    )  # fmt: skip
    return f"""## A knee that the importer has not seen

The model and its meshes are rewritten as another person's: {twin["scale"]:g} times as large, a
{twin["side"]} knee, with other names of bodies, joints, coordinates, wrap objects and fibres, the
meshes in frames of their own and at another scale, their triangles shuffled. It goes through the
same command, without a change of code. At {twin["instants"]} recorded poses, scaled:

- lengths of all fibres are {twin["scale"]:g} times as long to {_e(twin["length"])} of themselves,
  and tensions the same to {_e(twin["tension"])} N: the model's text carries every digit;
- contact, scaled back, stands against the record like that of the first knee:

{table}

Against the first knee, scaled, the contact force is within {100 * twin["force"]:.1f} %. It is not
the same to the last digit, because sizes of cells and distances of points are chosen in
millimetres: a larger knee gets other ones, and its meshes carry seven digits."""


def _limits(_) -> str:
    return """## What this does not show

- The record is a simulation. Pressures have not been compared with film, sensors or finite
  elements, and ligament forces not with measured ones.
- The patella and its contact are not part of the knee that is compared: where it stands is taken
  from the record.
- One person's knee, and its twin. Another mesh, coarser or noisier, fits worse; the import report
  states how well."""


def _made(results: dict) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    digest = results["document"]["imported_from"]["sha256"][:16]
    return f"""## Made with

{versions}; model file with SHA-256 beginning {digest}. The same comparisons, with their criteria,
are tests: `tests/validation/test_lenhart2015.py`."""


def _limit(key: str, value: float, digits: int = 0, sign: bool = False) -> str:
    """A share as percent, a distance as mm."""
    plus = "+" if sign else ""
    if key == "center":
        return f"{value:.{digits or 1}f} mm"
    return f"{100 * value:{plus}.{digits and 1}f} %"


def _e(value: float) -> str:
    """Two digits, without zeros in the exponent."""
    if value == 0:
        return "0"
    if 0.001 <= abs(value) < 1000:
        return f"{value:.2g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"
