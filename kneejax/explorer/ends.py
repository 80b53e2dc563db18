"""Ends of a ligament, dragged on their bones with gizmos."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from kneejax.explorer.answers import Answer
from kneejax.explorer.setting import ENDS, Setting, Subject
from kneejax.geometry import TIBIA
from kneejax.quantities import AXES
from kneejax.report.scene.surfaces import Places


class Ends:
    """Gizmos on the ends of one ligament, those on the femur and on the tibia."""

    def __init__(self, viser_scene: Any, subject: Subject, moved: Callable[[str, float], None]):
        """None are shown; `moved` is called with the name of an end's coordinate and its mm."""
        self._scene, self._subject, self._moved = viser_scene, subject, moved
        self._mirror = np.array([1.0, 1.0, -1.0 if subject.knee.side == "left" else 1.0])
        self._shown: dict[str, tuple[str, Any]] = {}
        self._places = Places({})

    def show(self, ligament: str, setting: Setting, answer: Answer) -> None:
        """Put the gizmos on a ligament's ends, where the bones of an answer are; no name takes them
        away."""
        self._places = Places.of(answer.state)
        names = {end: [f"{ligament}.{end}.{axis}" for axis in AXES] for end in ENDS}
        names = {end: each for end, each in names.items() if each[0] in self._subject.limits}
        for end in [*self._shown]:
            if end not in names or self._shown[end][0] != ligament:
                self._shown.pop(end)[1].remove()
        for end, each in names.items():
            if end not in self._shown:
                gizmo = self._scene.add_transform_controls(
                    f"/ends/{end}", scale=14.0, disable_rotations=True, disable_sliders=True,
                    depth_test=False,
                )  # fmt: skip
                gizmo.on_update(functools.partial(self._dragged, each))
                self._shown[end] = ligament, gizmo
            point = np.array([self._subject.value(setting, name) for name in each])
            there = self._places.moved(point, ENDS[end], TIBIA, 0) * self._mirror
            self._shown[end][1].position = tuple(map(float, there))

    def _dragged(self, names: list[str], event: Any) -> None:
        if event.client is None:
            return
        point = np.asarray(event.target.position) * self._mirror
        own = self._places.moved(point, TIBIA, ENDS[names[0].split(".")[1]], 0)
        for name, value in zip(names, own.tolist(), strict=True):
            self._moved(name, value)
