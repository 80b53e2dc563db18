"""Numbers replaced in a model's text, one word at a time."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

import numpy as np

from kneejax.files.opensim._model import Model, Offset, angles_xyz, turn_xyz
from kneejax.files.opensim._numbers import METRES_TO_MM, radians, shifted, unshifted, write_decimal
from kneejax.files.opensim._xml import Element, inserted, tokens


class Edits:
    """Edits of a model, collected.

    Attributes:
        model: the model.
        splices: first byte, end, and what stands there instead.
        changes: a sentence for each number or vector that changes.
    """

    def __init__(self, model: Model):
        self.model = model
        self.splices: list[tuple[int, int, bytes]] = []
        self.changes: list[str] = []

    def say(self, name: str, old, new) -> None:
        """Note a change, if it is one."""
        if old != new:
            self.changes.append(f"{name}: {_shown(old)} -> {_shown(new)}")

    def numbers(
        self, parent: Element, tag: str, changed: dict[int, Decimal], every: Sequence[Decimal]
    ) -> None:
        """Replace some words of a child; add the child if it is absent.

        Args:
            parent: the element.
            tag: the child.
            changed: which word -> its number.
            every: all numbers, for a child that has none yet.
        """
        if not changed:
            return
        leaf = parent.child(tag)
        whole = " ".join(write_decimal(value) for value in every)
        if leaf is None:
            self.splices.append(inserted(self.model.file, parent, tag, whole))
            return
        words = tokens(self.model.file, leaf)
        if len(words) == len(every):
            for i, value in changed.items():
                self.splices.append((*words[i], write_decimal(value).encode()))
        elif self.model.file.data[slice(*leaf.inner)] == b"/":
            text = f">{whole}</{tag}>".encode()
            self.splices.append((leaf.inner[0], leaf.end, text))
        else:
            self.splices.append((*leaf.inner, whole.encode()))

    def place(
        self,
        parent: Element,
        tag: str,
        carrier: Offset,
        old_mm: Sequence[float],
        new_mm: Sequence[float],
    ) -> None:
        """Move a point.

        Args:
            parent: the element that has a location.
            tag: its child with the location.
            carrier: from the coordinates of the location to the bone's.
            old_mm: shape `(3,)`, in the bone.
            new_mm: likewise.
        """
        changed = [i for i in range(3) if float(new_mm[i]) != old_mm[i]]
        if not changed:
            return
        x, y, z = (unshifted(value, METRES_TO_MM) for value in new_mm)
        location = carrier.point_back((x, y, z))
        stated = self.model.point(parent, tag)
        if carrier.rotation is None:
            kept = [location[i] if i in changed else stated[i] for i in range(3)]
            self.numbers(parent, tag, {i: kept[i] for i in changed}, kept)
            return
        a, b, c = location
        for _ in range(3):  # a rounding of the way there is taken back
            there = carrier.point((a, b, c))
            missing = [
                float(new_mm[i]) - shifted(there[i], METRES_TO_MM) for i in range(3)
            ]
            step = carrier.matrix.T @ np.array(missing) / 1e3
            a, b, c = (
                Decimal(repr(float(old) + float(more)))
                for old, more in zip((a, b, c), step, strict=True)
            )
        self.numbers(parent, tag, dict(enumerate((a, b, c))), (a, b, c))

    def turn(
        self,
        parent: Element,
        tag: str,
        carrier: Offset,
        old_deg: Sequence[float],
        new_deg: Sequence[float],
    ) -> None:
        """Turn a wrap object; arguments as in `place`, degrees."""
        changed = [i for i in range(3) if float(new_deg[i]) != old_deg[i]]
        if not changed:
            return
        stated = self.model.point(parent, tag)
        if carrier.rotation is None:
            kept = [radians(float(new_deg[i])) if i in changed else stated[i] for i in range(3)]
            self.numbers(parent, tag, {i: kept[i] for i in changed}, kept)
            return
        inner = carrier.matrix.T @ turn_xyz(np.deg2rad(new_deg))
        angles = [Decimal(repr(float(x))) for x in angles_xyz(inner)]
        self.numbers(parent, tag, dict(enumerate(angles)), angles)


def _shown(value) -> str:
    return " ".join(f"{float(x):.10g}" for x in (value if isinstance(value, list) else [value]))
