"""Starts of reorientation: parts at rest in their aspects, and what is done to them."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.geometry.decomposition import convex_pieces
from resting_aspects_ros.core.geometry.hull import convex_hull
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, angle_between, orientation_with_down
from resting_aspects_ros.simulation.actions import Action
from resting_aspects_ros.simulation.impulses import Disturbance
from resting_aspects_ros.simulation.starts import Body, Impulse, RestStarts
from resting_aspects_ros.simulation.step_action import OnBelt, Step
from resting_aspects_ros.simulation.vibration import Vibration

# Maximum lift height of a disturbance, m.
MAX_LIFT = 1.0


def body_of(part: Part) -> Body:
    """Return what impulses need to know of a part."""
    corners = part.hull_vertices - part.centre_of_mass
    triangles, normals = convex_hull(corners, part.name)[1:]
    moments, axes = np.linalg.eigh(part.inertia)
    return Body(
        mass=part.mass,
        inertia=part.inertia,
        corners=corners,
        normals=normals,
        offsets=(corners[triangles[:, 0]] * normals).sum(axis=1),
        radius=part.hull_radius,
        # Once for all workers, because the bits depend on the machine.
        moments=moments,
        axes=axes,
        compliance=np.asarray(np.linalg.inv(part.inertia)),
    )


def rest_starts(part: Part, aspects: Sequence[Aspect], impulse: Impulse) -> RestStarts:
    """Return parts at rest in these aspects, a row for each, to which an impulse is applied."""
    known = {aspect.id: _rests(aspect) for aspect in {each.id: each for each in aspects}.values()}
    orientations, weights = zip(*(known[aspect.id] for aspect in aspects), strict=True)
    return RestStarts(orientations, weights, impulse, body_of(part))


def action_starts(
    part: Part, aspects: Sequence[Aspect], action: Action, gravity: float
) -> RestStarts:
    """Return parts at rest in these aspects, a row for each, to which an action is applied.

    ``gravity`` is in m/s2.
    """
    if isinstance(action, Step):
        pieces = convex_pieces(part).corners
        edge = action.edge(tuple(corners - part.centre_of_mass for corners in pieces))
        starts = rest_starts(part, aspects, OnBelt(edge, gravity))
        return dataclasses.replace(starts, edge=edge)
    starts = rest_starts(part, aspects, action)
    if isinstance(action, Vibration):
        return dataclasses.replace(starts, motion=action)
    return starts


def disturbance_starts(
    part: Part, aspects: Sequence[Aspect], lift: Array, gravity: float
) -> RestStarts:
    """Return parts at rest in these aspects, disturbed with the energy of each lift height.

    Parameters
    ----------
    lift : (a, m) float
        Lift heights of each of the a aspects, m. Row a * m + j of the starts has ``lift[a, j]``.
    gravity : float
        m/s2.
    """
    wrong = lift[~((lift > 0) & (lift <= MAX_LIFT))]
    if wrong.size:
        raise InvalidValueError(
            f'invalid lift height {wrong.flat[0]:g}: expected more than 0 and at most '
            f'{MAX_LIFT:g} m'
        )
    each = [aspect for aspect in aspects for _ in range(lift.shape[1])]
    return rest_starts(part, each, Disturbance(lift.ravel(), gravity))


def _rests(aspect: Aspect) -> tuple[Array, Array]:
    """Return the orientations (m, 4) in which a part rests in an aspect, and their weights (m,).

    On a curved side, a direction has the weight of the links of the mesh that lead to it, so that
    all directions of the sweep are about equally probable for an irregular mesh, too.
    """
    down = aspect.directions[: aspect.level]
    weights = np.ones(len(down))
    links = aspect.links[(aspect.links < aspect.level).all(axis=1)]
    if len(links):
        one, other = links.T
        angle = angle_between(down[one], down[other])
        weights = np.zeros(len(down))
        for end in (one, other):
            np.add.at(weights, end, angle)
    return np.array([orientation_with_down(d) for d in down]), weights / weights.sum()
