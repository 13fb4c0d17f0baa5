"""Wanted contacts with floor and walls, such as aspect 1 on the belt and an edge at the wall."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.surroundings import contacts_in, scene_of
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.contacts import (
    CODE_TEXT,
    CORNER,
    EDGE,
    NONE,
    SIDE,
    ContactFinder,
)
from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.contact_counts import contacts_text
from resting_aspects_ros.simulation.conditions import DropConditions

# Contacts that are in no aspect, by name; also as tables and documents show them.
CODES: dict[str, int] = {'none': NONE, 'side': SIDE, 'edge': EDGE, 'corner': CORNER} | {
    text: code for code, text in CODE_TEXT.items()
}
EXPECTED = 'PLANE=CONTACT, such as belt=1,wall=edge'


@dataclass(frozen=True)
class WantedContacts:
    """Contacts with some of the planes; with the other planes, any contact is accepted.

    codes : tuple of (str, int)
        Name of a plane, and the id of the aspect that lies on it, or NONE, SIDE, EDGE or CORNER.
    """

    codes: tuple[tuple[str, int], ...]

    @property
    def text(self) -> str:
        """Such as 'belt: aspect 1, wall: edge'."""
        return contacts_text((name, code or 'nothing') for name, code in self.named)

    @property
    def named(self) -> list[tuple[str, int | str | None]]:
        """Contacts by the names of the planes, as `drop` shows them; None: not touched."""
        return [
            (name, code if code > NONE else CODE_TEXT[code] if code < NONE else None)
            for name, code in self.codes
        ]

    def found(self, finder: ContactFinder, poses: RestingPoses) -> npt.NDArray[np.bool_]:
        """Return which of the drops (n,) are at rest with these contacts."""
        contacts = finder.find(poses.position, poses.orientation)
        good = poses.status == RestStatus.SETTLED
        names = np.array([plane.name for plane in finder.planes])
        for name, code in self.codes:
            # Of several planes with the same name, the first one that is touched counts.
            own = contacts[:, names == name]
            first = (own != NONE).argmax(axis=1)
            good &= own[np.arange(len(own)), first] == code
        return np.asarray(good)


def finder_in(part: Part, conditions: DropConditions, aspects: AspectSet) -> ContactFinder:
    """Return what finds the contacts in surroundings; raises InvalidValueError without walls."""
    counts = contacts_in(scene_of(part, conditions), part, aspects)
    if counts is None:
        raise InvalidValueError(
            'invalid wanted contacts: expected surroundings with walls, such as --surroundings '
            'l_chute'
        )
    return counts.finder


def read_contacts(
    given: str | Mapping[str, Any], planes: Sequence[str], aspects: AspectSet
) -> WantedContacts:
    """Return wanted contacts from a text or a mapping; raises InvalidValueError."""
    pairs: list[tuple[str, Any]]
    if isinstance(given, Mapping):
        pairs = [(str(name), code) for name, code in given.items()]
    else:
        words = [word.partition('=') for word in given.split(',')]
        if not all(equals for _, equals, _ in words):
            raise InvalidValueError(f'invalid wanted contacts {shown(given)}: expected {EXPECTED}')
        pairs = [(name.strip(), code.strip()) for name, _, code in words]
    names = [name for name, _ in pairs]
    for name in names:
        if name not in planes:
            raise InvalidValueError(
                f'invalid plane {shown(name)} of wanted contacts: expected one of '
                f'{", ".join(dict.fromkeys(planes))}{did_you_mean(name, planes)}'
            )
        if names.count(name) > 1:
            raise InvalidValueError(f'invalid wanted contacts: expected {name} only once')
    if not names:
        raise InvalidValueError(f'invalid wanted contacts {shown(given)}: expected {EXPECTED}')
    return WantedContacts(tuple((name, _code(each, len(aspects))) for name, each in pairs))


def _code(given: Any, aspects: int) -> int:
    text = 'none' if given is None else str(given)
    if text in CODES:
        return CODES[text]
    if text.isdecimal() and 1 <= int(text) <= aspects:
        return int(text)
    raise InvalidValueError(
        f'invalid wanted contact {shown(given)}: expected an aspect from 1 to {aspects}, side, '
        'edge, corner or none'
    )
