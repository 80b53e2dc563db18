"""OpenSim itself on a movement: inverse dynamics, static optimisation, joint reaction.

A process of its own (`python -m kneejax.files.opensim.engine SETTINGS.json`): where OpenSim stops
without a word, only that process ends.
"""

import json
import sys
from pathlib import Path
from typing import Any

from kneejax.numerics import imported

#: Files that it writes: what OpenSim calls them, what they are called here.
MOMENTS = "inverse_dynamics.sto"
FORCES = "static_optimisation_force.sto"
REACTIONS = "joint_reactions.sto"
_NAME = "opensim"  # by which files begin that are not kept


def main(file: str) -> None:
    """Do what a file of settings says, as `whole_body.ask_opensim` writes it."""
    settings = json.loads(Path(file).read_text(encoding="utf-8"))
    osim = imported("opensim", "opensim", "opensim")
    osim.Logger.removeFileSink()
    osim.Logger.setLevelString("Error")
    folder = Path(settings["folder"])
    loads = {"ExternalLoadsFileName": settings["loads"]} if settings["loads"] else {}
    dynamics = _set(
        osim.InverseDynamicsTool(), ModelFileName=settings["model"],
        CoordinatesFileName=settings["motion"], **loads, StartTime=settings["begin_s"],
        EndTime=settings["end_s"], ExcludedForces=_words(osim, "Muscles"),
        ResultsDir=settings["folder"], OutputGenForceFileName=MOMENTS)
    _run(dynamics, "inverse dynamics")
    optimisation = _set(osim.StaticOptimization(), UseModelForceSet=True, ActivationExponent=2,
                        UseMusclePhysiology=True)
    forces = _analysed(osim, settings, optimisation, "StaticOptimization_force", loads)
    text = named_once(forces.read_text(encoding="utf-8"))
    (folder / FORCES).write_text(text, encoding="utf-8")
    reaction = _set(
        osim.JointReaction(), Name="JointReaction", ForcesFileName=str(folder / FORCES),
        JointNames=_words(osim, settings["joint"]), OnBody=_words(osim, settings["tibia"]),
        InFrame=_words(osim, settings["tibia"]))
    table = _analysed(osim, settings, reaction, "JointReaction_ReactionLoads", loads)
    table.rename(folder / REACTIONS)
    for other in folder.glob(f"{_NAME}_*"):
        other.unlink()


def named_once(table: str) -> str:
    """A table of OpenSim without columns of one name: contacts write theirs once for each force."""
    lines = table.splitlines()
    begin = lines.index("endheader") + 1
    names = lines[begin].split("\t")
    kept = [k for k, name in enumerate(names) if names.count(name) == 1]
    head = [f"nColumns={len(kept)}" if x.startswith("nColumns=") else x for x in lines[:begin]]
    rows = [line.split("\t") for line in lines[begin:] if line.strip()]
    return "\n".join([*head, *("\t".join(row[k] for k in kept) for row in rows)]) + "\n"


def _set(tool: Any, **values: Any) -> Any:
    """An object of OpenSim with values by its setters."""
    for name, value in values.items():
        getattr(tool, f"set{name}")(value)
    return tool


def _words(osim: Any, word: str) -> Any:
    words = osim.ArrayStr()
    words.append(word)
    return words


def _analysed(osim: Any, settings: dict, analysis: Any, ending: str, loads: dict) -> Path:
    """The table that an analysis of the movement writes."""
    folder = Path(settings["folder"])
    _set(analysis, StartTime=settings["begin_s"], EndTime=settings["end_s"],
         StepInterval=settings["every"])
    tool = _set(
        osim.AnalyzeTool(), Name=_NAME, ModelFilename=settings["model"],
        CoordinatesFileName=settings["motion"], **loads,
        ForceSetFiles=_words(osim, settings["actuators"]), ReplaceForceSet=False,
        SolveForEquilibrium=False, InitialTime=settings["begin_s"],
        FinalTime=settings["end_s"], ResultsDir=str(folder))
    tool.updAnalysisSet().cloneAndAppend(analysis)
    setup = folder / f"setup_{ending}.xml"
    tool.printToXML(str(setup))
    # Only a tool that is read from a file loads its model.
    _run(osim.AnalyzeTool(str(setup)), ending)
    setup.unlink()
    return folder / f"{_NAME}_{ending}.sto"


def _run(tool: Any, what: str) -> None:
    if not tool.run():
        raise SystemExit(f"OpenSim's {what} failed")


if __name__ == "__main__":
    main(sys.argv[1])
