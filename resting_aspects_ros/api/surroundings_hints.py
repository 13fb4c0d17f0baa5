"""Explanations of surroundings: where parts wedge, and why they slide, are lost, or lean."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.optimize import nnls

from resting_aspects_ros.core.errors import warn
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.surroundings.kinds import VGroove
from resting_aspects_ros.simulation.surroundings.scene import Scene

# How parts leave surroundings of a kind.
_LOST = {
    'bowl_track': 'they fell over the edge of the track',
    'mesh': 'they are beside the mesh or below it',
}


def outcome_hints(
    distribution: Distribution, conditions: DropConditions, radius: float | None
) -> Iterator[str]:
    """Yield a sentence for each outcome that only surroundings have.

    Parameters
    ----------
    radius : float or None
        Hull radius of the part, m; None if the part is not known: yields nothing.
    """
    surroundings = conditions.surroundings
    if surroundings is None or radius is None or not surroundings.known:
        return
    scene = surroundings.scene(conditions, radius)
    if distribution.sliding:
        reason = slide_reason(scene)
        yield (
            f'{_count(distribution.sliding, distribution)} slide or roll until the end'
            f'{": " if reason else ""}{reason}.'
        )
    if distribution.lost:
        how = _LOST.get(surroundings.shape.kind, 'they left the surroundings')
        yield f'{_count(distribution.lost, distribution)} are lost: {how}.'
    if distribution.unclassified and len(scene.faces) > 1:
        name = scene.faces[0].name.replace('_', ' ')
        yield (
            f'{_count(distribution.unclassified, distribution)} came to rest but do not lie in '
            f'an aspect on the {name}: they lean. The contacts show how.'
        )


def warn_of_surroundings(conditions: DropConditions, radius: float) -> None:
    """Warn, before the drops, of surroundings in which the drops can take long.

    Parameters
    ----------
    radius : float
        Hull radius of the part, m.
    """
    surroundings = conditions.surroundings
    if surroundings is not None and isinstance(surroundings.shape, VGroove):
        scene = surroundings.scene(conditions, radius)
        if reason := wedge_reason(scene, surroundings.shape.opening):
            warn(reason)


def wedge_reason(scene: Scene, opening: float) -> str:
    """Return why parts can wedge between the two planes of a groove; empty if they cannot.

    Two opposite contacts hold a part without any load if the line between them is in both cones
    of friction, which is possible if the opening, rad, is at most the sum of the friction angles.
    """
    holds = sum(math.atan(plane.contact.friction) for plane in scene.half_spaces)
    if opening > holds:
        return ''
    return (
        f'parts can wedge in the groove: its opening of {_degrees(opening)} does not exceed the '
        f'sum of the friction angles of its planes, {_degrees(holds)}; the simulation of '
        'wedged parts can take minutes'
    )


def _count(number: int, distribution: Distribution) -> str:
    if number == distribution.drops > 1:
        return f'All {number} parts'
    return f'{number} of {distribution.drops} parts'


def slide_reason(scene: Scene) -> str:
    """Return why no part can stay at rest in a scene; empty if friction can hold parts.

    Friction holds a part on a plane if the inclination is at most atan(friction). In a groove or
    a chute it holds the part along the groove if the component of gravity along it is at most the
    sum of friction times normal force of both planes. Empty if a surface moves.
    """
    if not scene.flat or not scene.free or len(scene.velocities()) > 1:
        return ''
    normals = np.array([plane.normal for plane in scene.half_spaces])
    friction = np.array([plane.contact.friction for plane in scene.half_spaces])
    if scene.free == 2:
        across = float(-normals[0] @ scene.down)
        along, holds = math.sqrt(max(1 - across**2, 0.0)), float(friction[0]) * across
        what = f'friction angle of {_degrees(math.atan(friction[0]))} (friction {friction[0]:g})'
    else:
        forces, _ = nnls(normals.T[1:], -scene.down[1:])
        across = float(np.linalg.norm(scene.down[1:]))
        along, holds = abs(float(scene.down[0])), float(friction @ forces)
        names = ' and '.join(dict.fromkeys(plane.name for plane in scene.half_spaces))
        what = f'{_degrees(math.atan2(holds, across))} at which friction on {names} holds a part'
    if along <= holds * (1 + 1e-9):
        return ''
    return f'the slope of {_degrees(math.atan2(along, across))} exceeds the {what}'


def _degrees(angle: float) -> str:
    return f'{math.degrees(angle):.3g} degrees'
