"""Conversions between counts of contacts with floor and walls, and ROS messages."""

import math

import numpy as np
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import AspectDistribution, ContactShare

from resting_aspects_ros.aspects.support import CORNER
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.aspect_conversions import share_fields
from resting_aspects_ros.rotations import LENGTH_TOLERANCE
from resting_aspects_ros.statistics.distribution import Distribution, Placement, Placements


def contact_msgs(distribution: Distribution) -> list[ContactShare]:
    """Return a message for each placement, the most frequent first; none without contacts."""
    contacts = distribution.contacts
    if contacts is None:
        return []
    rows = contacts.sorted_rows(distribution.interval, distribution.confidence)
    shares = share_fields([placement.count for placement, _ in rows], [each for _, each in rows])
    return [
        ContactShare(
            planes=list(contacts.planes),
            contacts=list(placement.contacts),
            symmetry_class=placement.symmetry_class,
            orientation=Quaternion(
                **dict(zip('xyzw', placement.orientation.tolist(), strict=True))
            ),
            **share,
        )
        for (placement, _), share in zip(rows, shares, strict=True)
    ]


def contacts_from(msg: AspectDistribution) -> Placements | None:
    """Return the placements in a message, the most frequent first; None if it has none.

    Raises InvalidValueError if they are inconsistent with the counts of the aspects.
    """
    if not msg.contacts:
        return None
    planes = tuple(msg.contacts[0].planes)
    settled = sum(each.count for each in msg.aspects) + msg.unclassified
    counted = sum(each.count for each in msg.contacts) + msg.contacts_uncounted
    if counted != settled:
        raise InvalidValueError(
            f'invalid contacts of run {msg.run.run_id}: expected {settled} drops at rest; they '
            f'have {counted}'
        )
    return Placements(
        planes,
        [_placement(each, planes, len(msg.aspects)) for each in msg.contacts],
        drops=msg.drops,
        uncounted=msg.contacts_uncounted,
    )


def _placement(msg: ContactShare, planes: tuple[str, ...], aspects: int) -> Placement:
    contacts = tuple(int(code) for code in msg.contacts)
    if (
        tuple(msg.planes) != planes
        or len(contacts) != len(planes)
        or not all(CORNER <= code <= aspects for code in contacts)
    ):
        raise InvalidValueError(
            f'invalid contacts {list(contacts)} with {list(msg.planes)}: expected a code from '
            f'{CORNER} to {aspects} for each of {list(planes)}'
        )
    orientation = np.array([getattr(msg.orientation, axis) for axis in 'xyzw'])
    if not abs(math.hypot(*orientation) - 1) <= LENGTH_TOLERANCE:
        raise InvalidValueError(
            f'invalid orientation {orientation.tolist()} of contacts: expected a unit quaternion'
        )
    return Placement(contacts, orientation, int(msg.count), int(msg.symmetry_class))
