"""Read the result of a run from a JSON document of `drop` or `request`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.inputs.count_files import MAX_BYTES
from resting_aspects_ros.api.inputs.counts import check_same_part
from resting_aspects_ros.api.inputs.csv_table import open_text
from resting_aspects_ros.api.inputs.result_json import (
    ReportAspect,
    RunDocument,
    counts_of,
    read_document,
)
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import PUBLISHED_FIELDS, Aspect, AspectSet, Sweep
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import METHOD, Distribution
from resting_aspects_ros.core.statistics.intervals import Counts


def document_result(
    path: Path,
    part_text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> DropResult:
    """Read a result; the part is ``part_text``, else that of the document if it is found.

    Raises InvalidValueError with file, field, value and what was expected.
    """
    with open_text(path, 'result file', MAX_BYTES) as file:
        document = read_document(path, file.read())
    given = counts_of(path, document)
    if given.run is None or not isinstance(document, RunDocument):
        raise InvalidValueError(
            f'{str(path)!r} has no run: expected a log (the folder of a run, or its '
            '.mcap file), or a JSON document of drop or request'
        )
    part = _part(path, document, part_text, unit, parts, body)
    ordered = sorted(document.aspects, key=lambda each: each.id)
    _check_aspects(path, ordered)
    aspects = AspectSet(given.part_sha256, tuple(map(_aspect, ordered)))
    if part is not None:
        found = find_aspects(part)
        aspects = found if found.matches(aspects) else aspects
    try:
        distribution = Distribution(
            aspects,
            given.tally.counts,
            given.tally.unclassified,
            given.tally.unsettled,
            given.tally.failed,
            document.interval,
            document.confidence,
            document.precision > 0,
            document.energy_growth,
        )
        distribution.intervals()
        history = _history(document, distribution)
    except ValueError as error:
        raise InvalidValueError(f'{str(path)!r}: {error}') from None
    return DropResult(
        distribution,
        given.run,
        part,
        METHOD,
        given.complete,
        document.convergence,
        history=history,
    )


def _part(
    path: Path,
    document: RunDocument,
    text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> Part | None:
    """Return the part of the document; raises RestingAspectsError if ``text`` is another part."""
    if text is not None:
        part = load_part(text, unit, parts, body)
        check_same_part(
            (f'--part {text!r}', part.name, part.part_sha256),
            (repr(str(path)), document.part, document.part_sha256),
        )
        return part
    try:
        if document.mesh_file is None:
            part = load_part(document.part, unit, parts, body)
        else:
            unit, body = unit or document.unit, body or document.body
            part = load_part(document.mesh_file, unit, None, body)
    except RestingAspectsError as error:
        why = str(error)
    else:
        if part.part_sha256 == document.part_sha256:
            return part
        why = f'{part.name!r} has changed since it was dropped'
    warn(f'the report has no pictures: {why}; name the part with --part')
    return None


def _check_aspects(path: Path, aspects: Sequence[ReportAspect]) -> None:
    """Raise InvalidValueError for aspects that a report cannot show."""
    ids = {each.id for each in aspects}
    for each in aspects:
        x, y = np.array(each.support, dtype=np.float64).reshape(-1, 2).T
        with np.errstate(over='ignore', invalid='ignore'):
            area = abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
        if each.sweep == 'POINT' and not 0 < area < math.inf:
            raise InvalidValueError(
                f'invalid support of aspect {each.id} in {str(path)!r}: expected a polygon'
            )
        if each.neighbour and each.neighbour not in ids:
            raise InvalidValueError(
                f'invalid neighbour {each.neighbour} of aspect {each.id} in {str(path)!r}: '
                'expected an aspect'
            )


def _aspect(given: ReportAspect) -> Aspect:
    fields = {name: _with_arrays(getattr(given, name)) for name in PUBLISHED_FIELDS}
    if given.min_barrier is None:
        fields['min_barrier'] = math.inf
    fields['sweep'] = Sweep[given.sweep]
    fields['support'] = fields['support'].reshape(-1, 2)
    down = fields['down_in_part']
    return Aspect(**fields, directions=down[None], links=np.zeros((0, 2), dtype=np.int64))


def _with_arrays(value: Any) -> Any:
    return np.array(value, dtype=np.float64) if isinstance(value, list | tuple) else value


def _history(document: RunDocument, distribution: Distribution) -> tuple[Counts, Counts] | None:
    """Return counts after ascending numbers of drops; raises ValueError if they are invalid."""
    rows = document.history
    if not rows:
        return None
    drops = np.array([row.drops for row in rows], dtype=np.int64)
    if any(len(row.counts) != len(distribution.aspects) for row in rows):
        raise ValueError('invalid history: expected a count of each aspect in each row')
    counts = np.array([row.counts for row in rows], dtype=np.int64).reshape(len(rows), -1)
    if not (np.diff(drops, prepend=0) > 0).all() or (counts.sum(axis=1) > drops).any():
        raise ValueError(
            'invalid history: expected ascending drops, each at least the sum of its counts'
        )
    if drops[-1] != distribution.drops or (counts[-1] != distribution.counts).any():
        raise ValueError('invalid history: expected the counts of the document in its last row')
    return drops, counts
