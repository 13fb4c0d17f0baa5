"""The rows of the outcomes of drops: their HTML, and the texts that change with the counts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.library import mesh_file
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drop_page import DrawnRows, outcome_rows, scene, share_fields
from resting_aspects_ros.report.drops import symmetry_text
from resting_aspects_ros.report.format import (
    GREY,
    Row,
    class_rows,
    interval_of,
    interval_text,
    model_range,
    probability_text,
    size_text,
)
from resting_aspects_ros.report.page import OutcomeRows, View, items_html
from resting_aspects_ros.statistics.distribution import OUTSIDE, Distribution, no_drops
from resting_aspects_ros.statistics.model_range import combined_range

# Side of the pictures, pixels: about twice their size on the page.
PIXELS = 192
# A bar has its full width at this share: a fixed scale, on which bars can be compared while the
# conditions change.
FULL = 1.0
# Outcomes without an aspect that have a row even if no drop ended so.
ALWAYS = ('unclassified', 'unsettled')


@dataclass(frozen=True)
class Source:
    """What is opened.

    given : str
        The name of an example part; or the name of the file as the user has it, for messages,
        commands and the name of the part.
    path : Path or None
        The uploaded file; None for an example.
    unit : str or None
        Of a mesh file without a unit; None: mm.
    body : int or None
        Number of the body of a file with several; None: all, as one part.
    """

    given: str
    path: Path | None = None
    unit: str | None = None
    body: int | None = None


@dataclass(frozen=True, eq=False)
class Opened:
    """A part with its aspects, and what does not change with the drops.

    rows : str
        HTML of the rows of all outcomes, with pictures.
    scene : dict
        Of the 3D view; see report.drop_page.scene.
    facts : sequence of (str, str)
        Labels and values of the part.
    names, pictures : sequence of str
        Of the symmetry classes; pictures are data URIs.
    """

    source: Source
    part: Part
    aspects: AspectSet
    rows: str
    scene: dict[str, object]
    facts: Sequence[tuple[str, str]]
    names: Sequence[str]
    pictures: Sequence[str]


def source_of(given: str) -> Source:
    """Return what the command names: an example part, or a file."""
    path = mesh_file(given)
    return Source(given) if path is None else Source(path.name, path.absolute())


def outside(distribution: Distribution) -> list[Row]:
    """Return a row for each outcome in no aspect, also for those that did not occur."""
    return [
        Row(name, count, interval_of(distribution, count), GREY)
        for name in OUTSIDE
        for count in [int(getattr(distribution, name))]
    ]


def empty_rows(source: Source, part: Part, aspects: AspectSet) -> Opened:
    """Return a part with what the page shows of it before the first drop."""
    distribution = no_drops(aspects)
    drawn = DrawnRows(distribution, part, PIXELS)
    drawn.outside = outside(distribution)
    rows = outcome_rows(distribution, drawn, part, level=True, longest=FULL)
    has_view = drawn.part is not None and bool(drawn.rows)
    return Opened(
        source,
        part,
        aspects,
        items_html(
            [
                *([View({}, rows[0].oblique, rows[0].name, '')] if has_view else []),
                OutcomeRows(rows, 0, has_view, many=len(rows)),
            ]
        ),
        scene(drawn.part, drawn.rows, drawn.posed_parts) if drawn.part else {},
        _facts(part, aspects),
        [row.name for row in drawn.rows],
        [row.oblique for row in rows[: len(drawn.rows)]],
    )


def _facts(part: Part, aspects: AspectSet) -> list[tuple[str, str]]:
    facts = [
        ('size', size_text(part)),
        ('triangles', f'{len(part.faces):,}'),
        ('aspects', f'{len(aspects)}'),
    ]
    if aspects.symmetry is not None:
        facts.append(('symmetry', symmetry_text(aspects.symmetry)))
    return facts


def changing_texts(distribution: Distribution, pending: str = '') -> list[dict[str, Any]]:
    """Return what changes in each row of `empty_rows` with the counts.

    pending : str
        Text in the place of a model range that is not known yet.
    """
    drops = distribution.drops
    texts = []
    for row in [*class_rows(distribution), *outside(distribution)]:
        fields = share_fields(row, drops, FULL)
        model_text = fields.pop('model_text')
        texts.append(
            {
                **fields,
                'count': f'{row.count:,} of {drops:,}',
                'range': model_text or (pending if row.aspects else ''),
                'hidden': not row.aspects and row.name not in ALWAYS and not row.count,
                'unseen': not row.count,
            }
        )
    return texts


def pickable_text(distribution: Distribution, pickable: frozenset[int]) -> str:
    """Return the share of the pickable classes together, with its interval; can be empty."""
    if not pickable or not distribution.drops:
        return ''
    members = distribution.aspects.classes()
    ids = [aspect.id for number in sorted(pickable) for aspect in members[number - 1]]
    found, model = distribution.combined_interval(ids), combined_range(distribution, ids)
    ranges = [interval_text(found), *([] if model is None else [model_range(model)])]
    return f'{probability_text(found)} pickable ({", ".join(ranges)})'
