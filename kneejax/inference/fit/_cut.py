"""Balances of a knee whose ligaments some tests had cut."""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments import slack_poses
from kneejax.geometry import State
from kneejax.inference.fit._frames import Passage
from kneejax.inference.fit._observed import Balance, Observations
from kneejax.mechanics import Knee
from kneejax.parameters import Selection, fibre_rows, fibres_cut, without_menisci
from kneejax.statics import LoadCases, Own, Slopes, Vary, balance_with_slopes


@dataclasses.dataclass(frozen=True)
class CutKnee:
    """Sets parameters, then cuts fibres; hashable, since it steers compiling.

    A ligament is cut after its number is set: a group's stiffness is shared out as that of the
    whole knee.

    Attributes:
        selection: the free parameters.
        fibres: rows of those that are cut.
    """

    selection: Selection
    fibres: tuple[int, ...]

    def __call__(self, knee: Knee, values: Any) -> Knee:
        """The knee with these values of the free parameters, and without those fibres."""
        knee = self.selection.apply(knee, values)
        torn = np.isin(np.arange(len(knee.ligaments.names)), self.fibres)
        left = jnp.where(torn, 0.0, knee.ligaments.stiffness)
        return eqx.tree_at(lambda k: k.ligaments.stiffness, knee, left)


def balances_of(
    knee: Knee, selection: Selection, cases: Observations, own: Own | None = None
) -> Balance:
    """Balances of a knee's variants at load cases, many at a time.

    Args:
        knee: gives everything that is not free.
        selection: the free parameters.
        cases: each with what is cut there.
        own: of several knees of one structure the numbers in which they differ
            (`balance_with_slopes`).

    Returns:
        A function of values `(variants, p)` and of balances at near ones; without these each
        variant is followed from the knee's reference pose.
    """
    if own and any(cases.cuts):
        raise ValueError("knees side by side have no ligament cut: one whole knee stands for all")
    every = cases.load_cases.of(knee)
    parts: list[tuple[np.ndarray, Balance]] = []
    for number, names in enumerate(cases.cuts):
        base, vary = without(knee, selection, names)
        rows = np.flatnonzero((cases.cut == number) & ~cases.moved)
        if len(rows):
            # A fit asks a hundred times: what is the same each time is made once.
            there = jax.tree.map(np.asarray, every.take(rows).plain())
            parts.append((rows, _balanced(base, vary, there, own)))
        parts += [
            (passage.rows, _passed(base, vary, passage))
            for passage in cases.passages
            if cases.cut[passage.rows[0]] == number
        ]

    def balance(values: np.ndarray, near: Slopes | None = None) -> Slopes:
        if len(parts) == 1:
            return parts[0][1](values, near)
        found = [of_part(values, near and near.at(rows)) for rows, of_part in parts]
        return Slopes.joined(found, [rows for rows, _ in parts])

    return balance


def _balanced(knee: Knee, vary: Vary, there: LoadCases, own: Own | None) -> Balance:
    """Load cases that are the same are one: a load that grows and is taken away again, as in most
    tests, meets each balance twice."""
    columns = [x.reshape(len(there), -1) for x in jax.tree.leaves(there)]
    _, first, case = np.unique(np.hstack(columns), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    once, place = first[order], np.argsort(order)[case.reshape(-1)]
    there = jax.tree.map(lambda x: x[once], there)

    def balance(values: np.ndarray, near: Slopes | None) -> Slopes:
        return balance_with_slopes(knee, vary, values, there, near and near.at(once), own).at(place)

    return balance


def _passed(knee: Knee, vary: Vary, passage: Passage) -> Balance:
    """A motion begins anew with other values: nothing of near ones is of use."""
    return lambda values, near: passage.slopes(knee, vary, values)


def without(knee: Knee, selection: Selection, names: tuple[str, ...]):
    """A knee in which some fibres cannot tear, and what sets its parameters and cuts them.

    Args:
        knee: gives everything that is not free.
        selection: the free parameters.
        names: ligaments or groups that are cut.

    Returns:
        The knee, and a function of it and of values.
    """
    if not names:
        return knee, selection.apply
    fibres = tuple(fibres_cut(knee, names))
    torn = np.isin(np.arange(len(knee.ligaments.names)), fibres)
    strain = jnp.where(torn, jnp.inf, knee.ligaments.failure_strain)
    whole = eqx.tree_at(lambda k: k.ligaments.failure_strain, knee, strain)
    whole = without_menisci(whole, names)
    return whole, CutKnee(selection, fibres)


def state_of(knee: Knee, cases: Observations, found: Slopes) -> State:
    """Where the bones are in the balances of one variant, `(load_cases,)`.

    Args:
        knee: whose bones they are.
        cases: at which it was balanced.
        found: one variant.
    """
    return State.of(cases.load_cases.prescribed, jnp.asarray(found.q[0].T), knee.bodies)


def slack_at(
    knee: Knee, selection: Selection, cases: Observations, found: Slopes
) -> dict[str, np.ndarray]:
    """Where each ligament and group is slack or cut, in the balances of one variant.

    Args:
        knee: gives everything that is not free.
        selection: the free parameters.
        cases: at which it was balanced.
        found: one variant.

    Returns:
        Ligament or group -> `(load_cases,)`.
    """
    contact_points = jnp.moveaxis(jnp.asarray(found.contact_points[0]), 0, -1)
    own = selection.apply(knee, jnp.asarray(found.values[0]))
    slack = slack_poses(own, state_of(knee, cases, found), contact_points)
    for number, names in enumerate(cases.cuts):
        gone = {*fibres_cut(knee, names)}
        for name, where in slack.items():
            if gone.issuperset(fibre_rows(knee, name)):
                where[cases.cut == number] = True
    return slack
