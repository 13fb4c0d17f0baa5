"""Where parts start that an action moves: at rest on a level plane or in surroundings."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.hull import convex_hull
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.rotations import angle_between, orientation_with_down
from resting_aspects_ros.simulation.actions import (
    Action,
    Disturbance,
    OnBelt,
    Step,
    Vibration,
    fall_speed,
)
from resting_aspects_ros.simulation.scene import HalfSpace, Scene, depth_along
from resting_aspects_ros.simulation.starts import Body, Edge, FoundStarts, Impulse, RestStarts
from resting_aspects_ros.simulation.surroundings_kinds import X, Z

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


# -- Steps in surroundings ------------------------------------------------------------------------


# Distance between a part and the roller at the start, R; more than the minimum radius of a roller.
BEHIND = 0.05


def check_step(name: str, step: Step, scene: Scene) -> None:
    """Raise InvalidValueError if a named step is not possible in surroundings."""
    floor = scene.bodies[0]
    level = isinstance(floor, HalfSpace) and np.array_equal(floor.normal, Z)
    if not (scene.flat and scene.free and level):
        raise InvalidValueError(
            f'invalid action {name} in surroundings: expected plane, slope, wall or chute, whose '
            'floor and walls are the same everywhere along x, so that they are the same above and '
            'below the edge; a fall into other surroundings is simulated by drops from initial '
            'states, those of parts that leave the upper belt'
        )
    speed = floor.contact.speed
    if speed not in (0.0, step.belt_speed):
        raise InvalidValueError(
            f'invalid belt speed {step.belt_speed:g} m/s of {name}: expected {speed:g} m/s, the '
            f'speed of the {floor.name} of the surroundings, which is the upper belt; the lower '
            'belt has the lower speed of the action'
        )


def below_edge(scene: Scene, edge: Edge) -> Scene:
    """Return the surroundings with the lower floor."""
    floor, *walls = scene.bodies
    contact = dataclasses.replace(floor.contact, speed=edge.lower_speed)
    return dataclasses.replace(
        scene, bodies=(dataclasses.replace(floor, contact=contact, along=X), *walls)
    )


def step_starts(
    part: Part, step: Step, scene: Scene, starts: FoundStarts, gravity: float
) -> FoundStarts:
    """Return parts at rest that are moved onto the upper floor, each as a whole behind the edge.

    ``starts`` are the parts at rest in the surroundings, and ``gravity`` is in m/s2.
    """
    pieces = convex_pieces(part).corners
    edge = step.edge(tuple(corners - part.centre_of_mass for corners in pieces))
    rows = zip(starts.positions, starts.orientations, strict=True)
    return dataclasses.replace(
        starts,
        positions=tuple(_behind(scene, edge, starts.body, *row) for row in rows),
        carried=np.asarray(scene.in_tray(edge.belt_speed * X[None])[0]),
        fall_speed=fall_speed(edge, gravity, starts.body.radius),
        edge=edge,
    )


def _behind(scene: Scene, edge: Edge, body: Body, position: Array, orientation: Array) -> Array:
    """Return the positions (n, 3) of the centre of mass on the upper floor, tray frame, m."""
    ahead = scene.in_tray(X[None])[0]
    front = depth_along(orientation, ahead, body.corners)
    place = scene.in_scene(position)
    place[:, 0] = -edge.radius - BEHIND * body.radius - front
    place[:, 2] += edge.height
    return scene.in_tray(place)
