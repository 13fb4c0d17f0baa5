"""The geometry of a flow graph: nodes on a circle, and curved arrows between them; pixels."""

import math

import numpy as np

from resting_aspects_ros.arrays import Array

# Distance between neighbouring nodes, and minimum radius of the circle, node radii.
_PITCH, _MIN_CIRCLE = 3.7, 3.1
_BEND = 0.19  # of an arrow, as a share of its length
_PULLS = np.arange(20) / 10  # towards the centre, as shares of the distance from it
_ARROW_GAP = 5  # between an arrow and a node


def node_places(count: int, node: float) -> tuple[Array, Array]:
    """Return the centres (count, 2) of nodes on a circle about the origin, and their angles, rad.

    Two nodes are side by side; more start at the top and go clockwise. A single one is in the
    centre, at the angle of the top.

    Parameters
    ----------
    node : float
        Radius of the nodes.
    """
    first = math.pi if count == 2 else math.pi / 2
    angles = first - 2 * math.pi * np.arange(count) / max(count, 1)
    radius = node * max(_PITCH * count / (2 * math.pi), _MIN_CIRCLE) if count > 1 else 0.0
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), angles


def arrow_outline(places: Array, start: int, end: int, node: float, width: float) -> Array:
    """Return the corners (n, 2) of an arrow between two nodes.

    The first and the last corner are the ends of its tail. The arrow is curved to the left of its
    direction, so that it does not cover its opposite, and towards the centre of all nodes, as far
    as it must be to clear the other nodes.

    Parameters
    ----------
    places : (g, 2) float
        Centres of all nodes, pixels.
    start, end : int
        Indices of the two nodes.
    node : float
        Radius of the nodes, pixels.
    width : float
        Pixels.
    """
    others = np.delete(places, [start, end], axis=0)
    for pull in _PULLS:
        # The opposite arrow has the same pull, so that the two do not meet.
        both = [_curve(places, *pair, pull) for pair in ((start, end), (end, start))]
        gaps = np.linalg.norm(np.concatenate(both)[:, None] - others, axis=2)
        if gaps.min(initial=np.inf) > node + width / 2 + _ARROW_GAP:
            break
    curve = both[0]
    ends = places[[start, end]]
    distance = np.linalg.norm(curve[:, None] - ends, axis=2).min(axis=1)
    curve = curve[distance >= node + _ARROW_GAP]
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    to_tip = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    head = min(9 + 0.8 * width, 0.6 * to_tip[0])
    shaft = curve[to_tip >= head]
    direction = np.gradient(shaft, axis=0)
    side = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    wings = side[-1] * (width / 2 + 5 + 0.15 * width)
    return np.concatenate(
        [
            shaft + side * width / 2,
            [shaft[-1] + wings, curve[-1], shaft[-1] - wings],
            (shaft - side * width / 2)[::-1],
        ]
    )


def _curve(places: Array, start: int, end: int, pull: float) -> Array:
    """Return (m, 2) points of a curve to the left of a straight line, pulled to the centre."""
    first, last, centre = places[start], places[end], places.mean(axis=0)
    along, middle = last - first, (first + last) / 2
    control = middle + _BEND * np.array([-along[1], along[0]]) + pull * (centre - middle)
    t = np.linspace(0, 1, 400)[:, None]
    points: Array = (1 - t) ** 2 * first + 2 * t * (1 - t) * control + t**2 * last
    return points
