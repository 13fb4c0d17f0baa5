"""A step in surroundings: from their floor, over an edge, onto a lower floor between their walls.

The edge is across x, the direction in which the surroundings are the same everywhere. Both floors
are parallel, and the walls continue. The surroundings are those of the upper floor, on which parts
lie before the step; the lower floor differs only in its speed.
"""

import dataclasses

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.geometry.decomposition import convex_pieces
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.edge import Edge
from resting_aspects_ros.simulation.starts import Body
from resting_aspects_ros.simulation.step_action import Step, fall_speed
from resting_aspects_ros.simulation.surroundings.kinds import X, Z
from resting_aspects_ros.simulation.surroundings.release import depth_along
from resting_aspects_ros.simulation.surroundings.rest_starts import FoundStarts
from resting_aspects_ros.simulation.surroundings.scene import HalfSpace, Scene

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
