"""Rows of a report page for the contacts in surroundings, with pictures."""

from collections.abc import Iterator

import numpy as np

from resting_aspects_ros.api.counted_run import CountedRun
from resting_aspects_ros.api.surroundings import scene_of
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.contacts import NONE, ContactPlane
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.report.aspect_pose import picture_part
from resting_aspects_ros.report.colours import GREY, aspect_colour, rgb
from resting_aspects_ros.report.contact_picture import contact_image
from resting_aspects_ros.report.page import ContactRow
from resting_aspects_ros.report.rounding import interval_text, probability_text

# Placements with a row of their own on the page, and the side of a picture, pixels.
MAX_ROWS = 24
PIXELS = 400


def contact_page_rows(result: CountedRun) -> Iterator[ContactRow]:
    """Yield a row for each of the most frequent placements; nothing without walls or part."""
    part, contacts, distribution = result.part, result.contacts, result.distribution
    scene = None if part is None else scene_of(part, result.run.conditions)
    if part is None or contacts is None or scene is None:
        return
    planes = [
        ContactPlane(face.name, scene.in_tray(face.normal[None])[0], face.offset)
        for face in scene.faces
    ]
    drawn = picture_part(part, distribution.aspects.aspects)
    rows = contacts.sorted_rows(distribution.interval, distribution.confidence)
    for placement, interval in rows[:MAX_ROWS]:
        yield ContactRow(
            contacts=tuple(
                (name.replace('_', ' '), _text(value))
                for name, value in contacts.named(placement).items()
            ),
            symmetry_class=placement.symmetry_class,
            count=placement.count,
            probability=probability_text(interval),
            interval=interval_text(interval),
            image=contact_image(
                drawn,
                placement.orientation,
                placement.contacts,
                planes,
                _colour(distribution.aspects, placement.contacts),
                PIXELS,
            ),
        )
    if rest := sum(placement.count for placement, _ in rows[MAX_ROWS:]):
        number = len(rows) - MAX_ROWS
        yield ContactRow(contacts=(('', f'{number} other placements'),), count=rest)


def _colour(aspects: AspectSet, contacts: tuple[int, ...]) -> Array:
    """Return the colour of the first aspect on which the part lies, lighter than its contacts."""
    lies = next((code for code in contacts if code > NONE), None)
    colour = np.array(rgb(GREY if lies is None else aspect_colour(aspects.aspects[lies - 1])))
    return np.asarray(0.65 * colour + 0.35)


def _text(value: int | str | None) -> str:
    if value is None:
        return 'no contact'
    return f'aspect {value}' if isinstance(value, int) else value
