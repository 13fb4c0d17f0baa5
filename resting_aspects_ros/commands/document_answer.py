"""A JSON document of `drop` or `request` as the answer that it holds."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.commands.convergence import Convergence
from resting_aspects_ros.commands.counts_document import read_document
from resting_aspects_ros.commands.csv_file import open_text
from resting_aspects_ros.commands.given_part import given_part
from resting_aspects_ros.core.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import METHOD, Distribution
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.core.history import Counts
from resting_aspects_ros.core.part import Part

ALLOWED = 'a log (the folder of a run, or its .mcap file), or a JSON document of drop or request'


def document_answer(
    path: Path, part_text: str | None, unit: str | None, parts: Path | None
) -> Answer:
    """Read it; the part is the one that is named, else that of the document, if it is found.

    Raises InvalidValueError with file, field, value and what is allowed.
    """
    with open_text(path, ALLOWED) as file:
        text = file.read()
    given = read_document(path, text)
    if given.run is None:
        raise InvalidValueError(f'{str(path)!r} is of no run, allowed is {ALLOWED}')
    document: dict[str, Any] = json.loads(text)
    part = _part(path, document, part_text, unit, parts)
    try:
        fields = sorted(document['aspects'], key=lambda each: each['id'])
        aspects = AspectSet(given.part_sha256, tuple(map(_aspect, fields)))
        if part is not None:
            found = find_aspects(part)
            aspects = found if found.is_like(aspects) else aspects
        distribution = Distribution(
            aspects,
            given.tally.counts,
            given.tally.unclassified,
            given.tally.unsettled,
            given.tally.failed,
            str(document['interval']),
            float(document['confidence']),
            given.run.precision > 0,
            float(document['energy_growth']),
        )
        distribution.intervals()
        history = _history(document, distribution)
        convergence = document.get('convergence')
        convergence = None if convergence is None else Convergence(**convergence)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(
            f'{str(path)!r} describes its aspects otherwise than this version writes them: '
            f'{type(error).__name__}, {error}'
        ) from None
    return Answer(
        distribution, given.run, part, METHOD, given.complete, convergence, history=history
    )


def _part(
    path: Path,
    document: dict[str, Any],
    text: str | None,
    unit: str | None,
    parts: Path | None,
) -> Part | None:
    """The part of the document; raises RestingAspectsError if the one that is named is another."""
    if text is not None:
        part = given_part(text, unit, parts)
        if part.part_sha256 != document['part_sha256']:
            raise InvalidValueError(
                f'--part is {text!r} with part_sha256 {part.part_sha256!r}, allowed is that of '
                f'{str(path)!r}: {document["part_sha256"]!r}'
            )
        return part
    mesh_file = document.get('mesh_file')
    try:
        if isinstance(mesh_file, str):
            part = given_part(mesh_file, document.get('unit') if unit is None else unit, None)
        else:
            part = given_part(document['part'], unit, parts)
    except RestingAspectsError as error:
        why = str(error)
    else:
        if part.part_sha256 == document['part_sha256']:
            return part
        why = f'{part.name!r} is another part than it was when it was dropped'
    print(f'warning: no pictures: {why}. --part names the part', file=sys.stderr)
    return None


def _aspect(fields: dict[str, Any]) -> Aspect:
    barrier = fields['least_barrier']
    down = np.array(fields['down_in_part'], dtype=np.float64)
    return Aspect(
        id=fields['id'],
        down_in_part=down,
        com_height=float(fields['com_height']),
        orientation=np.array(fields['orientation'], dtype=np.float64),
        support=np.array(fields['support'], dtype=np.float64).reshape(-1, 2),
        basin_share=float(fields['basin_share']),
        least_barrier=math.inf if barrier is None else float(barrier),
        neighbour=int(fields['neighbour']),
        symmetry_class=fields['symmetry_class'],
        multiplicity=int(fields['multiplicity']),
        rolls=bool(fields['rolls']),
        sweep=Sweep[fields['sweep']],
        axis=np.array(fields['axis'], dtype=np.float64),
        directions=down[None],
        links=np.zeros((0, 2), dtype=np.int64),
    )


def _history(document: dict[str, Any], distribution: Distribution) -> tuple[Counts, Counts] | None:
    rows = document.get('history')
    if not rows:
        return None
    drops = np.array([row['drops'] for row in rows], dtype=np.int64)
    counts = np.array([row['counts'] for row in rows], dtype=np.int64).reshape(
        len(rows), len(distribution.aspects)
    )
    if not (np.diff(drops, prepend=0) > 0).all() or (counts < 0).any():
        raise ValueError('history does not ascend')
    if (counts.sum(axis=1) > drops).any():
        raise ValueError('history counts more than its drops')
    if drops[-1] != distribution.drops or (counts[-1] != distribution.counts).any():
        raise ValueError('history does not end with the counts')
    return drops, counts
