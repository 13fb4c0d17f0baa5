"""Conversions between aspects and their ROS messages."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from geometry_msgs.msg import Point32, Polygon, Quaternion, Vector3
from resting_aspects_interfaces.msg import Aspect

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects import aspect_set
from resting_aspects_ros.aspects.aspect_set import AspectSet, Sweep
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

# Indexed by their codes in the message Aspect.
SWEEPS = (Sweep.POINT, Sweep.ARC, Sweep.RING, Sweep.DOME, Sweep.SPHERE)
# Fields with the same name and type in Aspect and its message.
_ASPECT_FIELDS = tuple(
    each.name
    for each in dataclasses.fields(aspect_set.Aspect)
    if each.repr and each.type in (bool, int, float)
)


def share_fields(counts: list[int], intervals: Sequence[Interval]) -> list[dict[str, object]]:
    """Return the fields of shares: counts of drops, and the intervals of their probabilities."""
    return [
        {'count': k, 'probability': i.probability, 'lower': i.lower, 'upper': i.upper}
        for k, i in zip(counts, intervals, strict=True)
    ]


def ranged_fields(distribution: Distribution) -> list[dict[str, object]]:
    """Return the fields of the shares of a distribution, with its model range."""
    shares = share_fields(distribution.counts.tolist(), distribution.intervals())
    return [
        share | model_fields(model)
        for share, model in zip(shares, distribution.model_intervals(), strict=True)
    ]


def model_fields(model: Interval | None = None) -> dict[str, object]:
    """Return the fields of a model range; 0 and 1 if it is not known."""
    if model is None:
        return {'model_lower': 0.0, 'model_upper': 1.0}
    return {'model_lower': model.lower, 'model_upper': model.upper}


def aspect_msgs(aspects: AspectSet, shares: Sequence[Mapping[str, object]]) -> list[Aspect]:
    """Return the messages for aspects with the fields of their shares."""
    return [
        Aspect(**_aspect_fields(aspect), **share)
        for aspect, share in zip(aspects.aspects, shares, strict=True)
    ]


def _aspect_fields(aspect: aspect_set.Aspect) -> dict[str, object]:
    orientation = aspect.orientation.tolist()
    points = [Point32(x=x, y=y) for x, y in aspect.support.tolist()]
    return {
        **{name: getattr(aspect, name) for name in _ASPECT_FIELDS},
        'sweep': SWEEPS.index(aspect.sweep),
        'axis': _vector_msg(aspect.axis),
        'down_in_part': _vector_msg(aspect.down_in_part),
        'orientation': Quaternion(**dict(zip('xyzw', orientation, strict=True))),
        'support': Polygon(points=points),
    }


def aspects_from(part_sha256: str, msgs: Iterable[Aspect]) -> AspectSet:
    """Return the aspects of a version of a part; raises InvalidValueError for an invalid code."""
    return AspectSet(part_sha256, tuple(_aspect_from(msg) for msg in msgs))


def _aspect_from(msg: Aspect) -> aspect_set.Aspect:
    if msg.sweep >= len(SWEEPS):
        raise InvalidValueError(
            f'invalid sweep {msg.sweep} of aspect {msg.id}: expected 0 to {len(SWEEPS) - 1}'
        )
    return aspect_set.Aspect(
        **{name: getattr(msg, name) for name in _ASPECT_FIELDS},
        sweep=SWEEPS[msg.sweep],
        axis=_vector(msg.axis),
        down_in_part=_vector(msg.down_in_part),
        orientation=np.array([getattr(msg.orientation, axis) for axis in 'xyzw']),
        support=np.array([(p.x, p.y) for p in msg.support.points]).reshape(-1, 2),
        # The message does not contain the flat sides that approximate a curved side, since
        # nothing is classified with the result.
        directions=_vector(msg.down_in_part)[None],
        links=np.zeros((0, 2), dtype=np.int64),
    )


def _vector_msg(vector: Array) -> Vector3:
    return Vector3(**dict(zip('xyz', vector.tolist(), strict=True)))


def _vector(msg: Vector3) -> Array:
    return np.array([msg.x, msg.y, msg.z])
