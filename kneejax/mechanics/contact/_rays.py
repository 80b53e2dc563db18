"""Where a line leaves a solid: a short search for the usual line, a bounded one for the others.

The depth of a point `p` along a unit direction `n` is the `u` at which the level `F(p - u n)` of
the solid vanishes. Newton's first step, taken from the point itself, is `first = -F / c`, `c` how
fast the level rises along the line (never less than a fifth of its gradient). Two looks at the
surface and a third that judges them are enough for a line that leaves the solid nearby and steeply:
the usual one. If a single line is not that usual, all that are not are searched between 0 and 1.8
times `first`, where Newton's steps cannot leave the bracket.

A line that grazes the solid leaves it ever farther away, and then not at all. Where the level is
quadratic, that happens at twice `first`. Beyond 1.5 times `first` the depth therefore comes to rest
below 1.8 times `first`, and stays there for lines that have no exit: the depth, its slope and its
bend are continuous, and no point beneath the surface is ever taken for one that is apart.

Lines start at `start`, mm, in the axes of the solid `femoral`, and go against the unit direction
`along`; what is `known` of them stays as it is where `is_known`.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry import Surface, Vector
from kneejax.numerics import instantiate, jvp_of_moved, ruled

#: Parts of Newton's first step up to which a depth is the ray's own, and at which it rests.
STRAIGHT, HELD = 1.5, 1.8
# The step that may be left, mm, of a point that touches; how much more of one that is as far
# apart as contact takes to fade out; and of a point that is searched thoroughly. It is taken too,
# as it is foreseen and once more by the look that uses the depth: a depth is off by the square of
# what is left then, but its slope and what that changes by are off by this itself.
_ENOUGH, _APART_ENOUGH, _FADES, _THOROUGH = 1e-5, 3e-5, 0.02, 1e-7
# A step leaves its square, times half of what the level bends (1/mm) at least.
_BENT = 0.03
# Cosines between a line and the gradient: where the line counts as grazing, and as steep.
_GRAZING, _STEEP = 0.1, 0.3
#: Slope along the line that a usual ray has at least; below the second no step is taken at all.
LEVEL, _FLAT = 0.05, 1e-3
_QUICK_LOOKS, _MOST_QUICK_LOOKS, _NEWTON_LOOKS, _MOST_LOOKS = 2, 5, 6, 60
#: Beyond this distance, mm, contact has faded out: a depth need only be known to be less.
APART = 2.5
# Newton's first step where that is so, whatever the search finds.
_SURELY_APART = 4.0
#: The largest distance that is told, mm.
FARTHEST = 1e3
#: The longest step, mm, that the look that uses a depth takes.
LAST_STEP = 0.1


class Exit(eqx.Module):
    """Where lines leave a solid.

    Attributes:
        depth: how far back along the line, mm; negative outside the solid.
        first: Newton's first step, mm.
        held: whether the line has no exit within reach: the depth rests at `HELD * first`.
        lost: whether the search has not ended.
    """

    depth: Array
    first: Array
    held: Array
    lost: Array


def look(femoral: Surface, depth: Array, start: Vector, along: Vector):
    """Level, its gradient, and how fast it falls with the direction, at a depth of a line."""
    level, gradient = femoral.level_and_slope(start - depth * along)
    return level, gradient, gradient @ along


def quick_exit(femoral: Surface, start: Vector, along: Vector) -> tuple[Array, Array]:
    """Exits of lines that leave the solid nearby and steeply, from two looks or a few more.

    Returns:
        Depths, mm, and whose are sound: those whose steps have ended unheld, or so far apart that
        nothing depends on them. The look that uses a depth takes the step that is left.
    """
    femoral, start, along = lax.stop_gradient((femoral, start, along))

    def nearer(state):
        step, depth, last, before, first = state
        level, _, steep = look(femoral, depth, start, along)
        newton = level / jnp.minimum(steep, -_STEEP)
        # A ray that is through stays: it must not depend on those that are searched beside it.
        goes = (step < _QUICK_LOOKS) | (_coarse(depth, last, before) & ~_apart(depth, first))
        depth = jnp.where(goes, depth + newton, depth)
        last, before = jnp.where(goes, newton, last), jnp.where(goes, last, before)
        return step + 1, depth, last, before, jnp.where(step == 0, newton, first)

    def goes_on(state) -> Array:
        step, depth, last, before, first = state

        def left() -> Array:
            return jnp.any(_coarse(depth, last, before) & ~_apart(depth, first))

        return lax.cond(step < _QUICK_LOOKS, lambda: True, left) & (step < _MOST_QUICK_LOOKS)

    # A loop, though it is short: looks that follow each other in one kernel are computed anew for
    # each use of what they found, and three of them took minutes to compile. A look hands on
    # nothing but its step: with the level and its slope besides, it took twice the time.
    nothing = jnp.zeros(jnp.broadcast_shapes(jnp.shape(start[0]), jnp.shape(along[0])))
    state = (jnp.asarray(0), nothing, nothing, nothing, nothing)
    _, depth, last, before, first = lax.while_loop(goes_on, nearer, state)
    found = depth + last * jnp.minimum(_leaves(last, before), 0.5)
    astray = (jnp.abs(found) > STRAIGHT * jnp.abs(first)) | (found * first < 0.0)
    # A number that is none is nobody's fault here: the solver refuses it.
    unsound, far = astray | _coarse(depth, last, before), _apart(found, first)
    resting = jnp.clip(found, -FARTHEST, -APART - 2.0 * LAST_STEP)
    return jnp.where(unsound & far, resting, found), ~unsound | far


def _leaves(last: Array, before: Array) -> Array:
    """The next step as a part of the last: each is as much of the square of that before it."""
    return (last / jnp.where(before == 0.0, 1.0, before)) ** 2


def _coarse(depth: Array, last: Array, before: Array) -> Array:
    """Whether the step after the last one matters."""
    size = jnp.abs(last)
    return size * jnp.maximum(_BENT * size, _leaves(last, before)) > _allowed(depth)


def _apart(depth: Array, first: Array) -> Array:
    return (depth < -APART) | (first < -_SURELY_APART)


def thorough_exit(
    femoral: Surface, start: Vector, along: Vector, known: Array, is_known: Array
) -> Exit:
    """Exit of any line, by Newton's steps in a bracket that halves where they do not end."""
    femoral, start, along, known = lax.stop_gradient((femoral, start, along, known))

    def closer(state):
        step, depth, first, near, far, closed, held, done = state
        begins = step == 0
        level, gradient, steep = look(femoral, jnp.where(begins, 0.0, depth), start, along)
        first = jnp.where(begins, -level / rise(gradient, along)[0], first)
        passed = ~begins & (level * first > 0.0)
        near = jnp.where(passed | begins, near, depth)
        far = jnp.where(begins, HELD * first, jnp.where(passed, depth, far))
        closed = closed | passed
        newton = depth + level / jnp.where(steep < -_FLAT, steep, -1.0)
        within = (steep < -_FLAT) & ((newton - near) * (far - newton) >= 0.0)
        # Newton's steps end in a few; where they do not, every third halves the bracket.
        halves = closed & (step > _NEWTON_LOOKS) & (step % 3 == 2)
        bracketed = jnp.where(closed, 0.5 * (near + far), HELD * first)
        further = jnp.where(within & ~halves, newton, bracketed)
        further = jnp.where(begins, first, further)
        ends = ~passed & (jnp.abs(depth) >= HELD * jnp.abs(first)) & (first != 0.0) & ~begins
        small = within & (jnp.abs(newton - depth) <= _THOROUGH)
        narrow = closed & (jnp.abs(far - near) <= 1e-9)
        found = ~begins & ~ends & (small | narrow | (first == 0.0) | ~jnp.isfinite(level))
        depth = jnp.where(done | ends, depth, jnp.where(small, newton, further))
        depth = jnp.where(begins & ~done, first, depth)
        held = held | (ends & ~done)
        return step + 1, depth, first, near, far, closed, held, done | ends | found

    shape = jnp.broadcast_shapes(jnp.shape(start[0]), jnp.shape(along[0]))
    nothing, no = jnp.zeros(shape), jnp.zeros(shape, bool)
    state = (jnp.asarray(0), known, nothing, nothing, nothing, no, no, is_known)
    # One look at least: it gives the first step of those that are known.
    searches = lambda s: (s[0] < 1) | ((s[0] < _MOST_LOOKS) & ~jnp.all(s[-1]))  # noqa: E731
    _, depth, first, _, _, _, held, done = lax.while_loop(searches, closer, state)
    return Exit(depth, first, held, ~done)


def rise(gradient: Vector, along: Vector) -> tuple[Array, Array, Array]:
    """How fast the level rises against a direction, never less than a fifth of its gradient.

    Returns:
        The rise `c`, and what it is made of: `dc = by_size * d|gradient| - by_slope * d(slope)`
        with `slope` the gradient along the direction.
    """
    size = jnp.sqrt(gradient @ gradient)
    cosine = -(gradient @ along) / size
    t = jnp.clip((cosine - _GRAZING) / (_STEEP - _GRAZING), 0.0, 1.0)
    width = _STEEP - _GRAZING
    # From the constant 0.2 at a cosine of 0.1 to the cosine itself at 0.3, smooth at both.
    least = 0.5 * (_GRAZING + _STEEP)
    share = jnp.maximum(cosine, _STEEP) - _STEEP + least + width * (t**3 - 0.5 * t**4)
    by_slope = t * t * (3.0 - 2.0 * t)
    return size * share, share - cosine * by_slope, by_slope


def faded(depth: Array) -> tuple[Array, Array]:
    """A depth that comes to rest between half of `APART` and `APART`, and its derivative.

    What the rounded onset leaves of contact there, some 1e-5 of a mm, must not change with rays
    that lead nowhere.
    """
    begin = 0.5 * APART
    t = jnp.clip((-depth - begin) / (APART - begin), 0.0, 1.0)
    rest = (APART - begin) * (t - t**3 + 0.5 * t**4)
    return jnp.maximum(depth, -begin) - rest, 1.0 - t * t * (3.0 - 2.0 * t)


def hold(ratio: Array) -> tuple[Array, Array]:
    """A ratio that comes to rest between `STRAIGHT` and `HELD`, and its derivative."""
    width = HELD - STRAIGHT
    t = jnp.clip((ratio - STRAIGHT) / width, 0.0, 1.0)
    held = jnp.minimum(ratio, STRAIGHT) + width * (t - t**3 + 0.5 * t**4)
    return held, 1.0 - t * t * (3.0 - 2.0 * t)


def any_depth(
    femoral: Surface, start: Vector, along: Vector, found: Exit
) -> tuple[Array, Vector, Vector]:
    """Depth of any line, held or not, and its slopes.

    Returns:
        Depth, mm; its derivatives by a motion of the start and by one of the direction.
    """
    given = femoral, start, along, found
    return ruled(_near_rule, _near_exit(*jax.tree.map(lax.stop_gradient, given)), *given)


def _near_rule(_, primals, tangents):
    femoral, start, along, found = primals
    # One step of Newton's rule has the first derivative; for further ones the exit follows.
    depth = jnp.where(found.held, found.depth, follow(femoral, start, along, found.depth))
    found = dataclasses.replace(found, depth=depth)

    def near(femoral: Surface, start: Vector, along: Vector) -> tuple[Array, Vector, Vector]:
        return _near_exit(femoral, start, along, found)

    return jvp_of_moved(near, (femoral, start, along), tuple(tangents[:3]))


def _near_exit(
    femoral: Surface, start: Vector, along: Vector, found: Exit
) -> tuple[Array, Vector, Vector]:
    """See `any_depth`: the exit is a step of Newton's rule from where it was found."""
    # The surface is asked at both ends of the line at once: half of what there is to compile.
    end = start - found.depth * along
    pairs = zip(start, end, strict=True)
    ends = Vector(*(jnp.stack(jnp.broadcast_arrays(*pair)) for pair in pairs))
    (level, left), gradients, bends = femoral.level_slope_and_bend(ends)
    (gradient, there), (bend, bend_there) = _of_each(gradients), _of_each(bends)
    rises, by_size, by_slope = rise(gradient, along)
    first = -level / rises
    size = jnp.sqrt(gradient @ gradient)
    of_rise = by_size / size * gradient - by_slope * along
    first_by_start = -(gradient + first * (bend @ of_rise)) / rises
    first_by_along = first * by_slope / rises * gradient

    steep = there @ along
    step = jnp.where(found.held, 0.0, left / jnp.where(steep < -_FLAT, steep, -1.0))
    own = found.depth + step
    # A step that is nothing in length: it is how the end follows the line.
    there = there - step * (bend_there @ along)
    steep = there @ along
    own_by_start = there / jnp.where(steep < -_FLAT, steep, -1.0)

    some = found.first != 0.0
    ratio = jnp.where(some, own / jnp.where(some, first, 1.0), 1.0)
    ratio = jnp.where(found.held, HELD, ratio)
    held, by_ratio = hold(ratio)
    rest = held - ratio * by_ratio
    depth = jnp.where(ratio <= STRAIGHT, own, first * held)
    by_start = by_ratio * own_by_start + rest * first_by_start
    by_along = -by_ratio * own * own_by_start + rest * first_by_along
    return depth, by_start, by_along


def _of_each(stacked):
    """What was computed for two places, apart."""
    return (jax.tree.map(lambda x, k=k: x[k] if jnp.ndim(x) else x, stacked) for k in (0, 1))


def follow(femoral: Surface, start: Vector, along: Vector, depth: Array) -> Array:
    """An exit that has been found, differentiable by the implicit function theorem.

    Args:
        femoral: the solid.
        start: mm, in its frame.
        along: unit direction.
        depth: of the exit, mm; nothing is differentiated through it.
    """
    return ruled(_follow_rule, depth, femoral, start, along)


def _follow_rule(depth: Array, primals, tangents):
    femoral, start, along = of_line = primals
    moved = [not isinstance(t, SymbolicZero) for t in jax.tree.leaves(tangents[0])]
    # A surface that is not perturbed need not be differentiated.
    if any(moved):
        names, rates = tuple(of_line), instantiate(tangents[:3])
    else:
        names, rates = (start, along), instantiate(tangents[1:3])

    def level(*where):
        solid = where if any(moved) else (femoral, *where)
        found, _, steep = look(solid[0], depth, *solid[1:])
        return found, steep

    _, change, steep = jax.jvp(level, names, rates, has_aux=True)
    return depth, change / jnp.where(steep < -_FLAT, steep, -1.0)


def _allowed(depth: Array) -> Array:
    """The step that may be left, mm: more, the farther apart."""
    apart = jnp.minimum(depth, 0.0) / _FADES
    return _ENOUGH + _APART_ENOUGH * apart * apart
