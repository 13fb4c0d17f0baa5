"""Drop many parts under the same conditions, with a report for each and an index page."""

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.drop_counter import DropCounter
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.load_part import load_part, mesh_file
from resting_aspects_ros.api.output_files import make_folder, whole_file
from resting_aspects_ros.api.plan_drops import plan_drops
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.surroundings import with_surroundings
from resting_aspects_ros.core.errors import (
    EngineError,
    OutputError,
    RestingAspectsError,
    analysis,
    warn,
)
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import METHOD
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.run_description import DEFAULT_DROPS, DEFAULT_SEED, check_seed
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.studies.batch_result import BatchEntry, BatchResult
from resting_aspects_ros.studies.part_files import missing_parts, part_sources, source_text

INDEX = 'index.html'
DOCUMENT = 'distribution.json'


def drop_batch(
    parts: Sequence[Part | str | Path],
    drops: int | None = None,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    precision: float = 0.0,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    surroundings: str | Path | Surroundings | None = None,
    unit: str | None = None,
    check: Callable[[Part], None] = lambda _: None,
    out: str | Path | None = None,
    workers: int | Workers | None = None,
    progress: bool = False,
    stopped: Callable[[], bool] = lambda: False,
    **conditions: Any,
) -> BatchResult:
    """Drop each of many parts; a part that fails does not cost the others.

    Parameters
    ----------
    parts : sequence of Part, str or Path
        Parts, or what `load_part` accepts; a folder stands for the mesh files in it.
    unit : str, optional
        Unit of the mesh files.
    check : callable
        Raises InvalidValueError for a part that should not be dropped.
    out : str or Path, optional
        Folder for index.html and a folder with a report of each part.
    stopped : callable
        The batch ends early if it returns True.
    seed : int
        Of the batch. Each part has a seed of its own, see `part_seed`, so that the drops of
        different parts are independent.
    drops, surface, precision, interval, confidence, surroundings, workers, progress
        As for `drop`.
    **conditions : float
        Conditions that differ from the surface, in SI units.

    Raises
    ------
    InvalidValueError
        A condition is out of bounds, or a folder has no mesh file.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    OutputError
        A file cannot be written.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> batch = ra.drop_batch(['tetrahedron', 'missing.stl'], 20)
    >>> [entry.error for entry in batch.entries]
    ['', "mesh 'missing.stl' does not exist"]
    """
    check_seed(seed)
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    sources = _sources(parts)
    folder = None if out is None else Path(out)
    if folder is not None:
        make_folder('--out', folder)
    count = (0 if precision else DEFAULT_DROPS) if drops is None else drops
    entries: list[BatchEntry] = []
    missing = missing_parts(sources, unit)
    with given_workers(workers) as pool:
        for k, source in enumerate(sources):
            if stopped():
                break
            entry = BatchEntry(source_text(source))
            try:
                part = _loaded(source, unit, missing.get(k))
                check(part)
                plan = plan_drops(
                    part,
                    given,
                    drops=count,
                    seed=part_seed(seed, part),
                    precision=precision,
                    interval=interval,
                    confidence=confidence,
                )
                counter = DropCounter(plan.empty, plan.run, precision, consumers=plan.consumers)
                with DropProgress(part.name, plan.run.drops, shown=progress) as bar:
                    counter.drop(plan.job, pool, bar.update, stopped)
                    bar.end(counter.distribution.drops)
                if not counter.complete:
                    break
                result = DropResult(
                    counter.distribution,
                    plan.run,
                    part,
                    METHOD,
                    counter.complete,
                    mesh_file=None if isinstance(source, Part) else mesh_file(source),
                    history=counter.history.points(),
                    contacts=plan.contacts,
                )
                own = _folder(part.name, [each.folder for each in entries])
                entry = dataclasses.replace(entry, result=result, folder=own)
                if folder is not None:
                    make_folder('--out', folder / own)
                    result.save_json(folder / own / DOCUMENT)
                    with analysis(f'the report on {part.name}'):
                        result.report(folder / own)
            except (EngineError, OutputError):
                raise
            except RestingAspectsError as error:
                entry = dataclasses.replace(entry, error=str(error))
            entries.append(entry)
            if folder is not None:
                with analysis('the index of the batch'):
                    _write_index(BatchResult(tuple(entries), False, confidence, folder, seed))
    complete = len(entries) == len(sources) and not any(entry.error for entry in entries)
    batch = BatchResult(tuple(entries), complete, confidence, folder, seed)
    if folder is not None:
        with analysis('the index of the batch'):
            _write_index(batch, compare=True)
    return batch


def part_seed(seed: int, part: Part) -> int:
    """Return the seed of a part, which follows from that of the batch and from the part alone.

    It depends neither on the other parts nor on their order.
    """
    text = f'{seed} {part.part_sha256}'.encode('ascii')
    return int.from_bytes(hashlib.sha256(text).digest()[:8], 'little')


def _sources(parts: Sequence[Part | str | Path]) -> list[Part | str | Path]:
    found: list[Part | str | Path] = []
    for each in parts:
        found += [each] if isinstance(each, Part) else part_sources([each])
    return found


def _loaded(
    source: Part | str | Path, unit: str | None, error: RestingAspectsError | None
) -> Part:
    """Return a part; raises the error that is already known, if any."""
    if error is not None:
        raise error
    if isinstance(source, Part):
        return source
    part = load_part(source, unit if mesh_file(source) is not None else None)
    for warning in part.warnings:
        warn(warning)
    return part


def _folder(name: str, taken: Sequence[str]) -> str:
    """Return a folder for a part; two parts can have the same name."""
    number, found = 1, name
    while found in taken:
        number += 1
        found = f'{name}_{number}'
    return found


def _write_index(batch: BatchResult, *, compare: bool = False) -> None:
    # This import takes about a second.
    from resting_aspects_ros.studies.batch_page import batch_page

    assert batch.folder is not None
    with whole_file(batch.folder / INDEX) as part:
        part.write_text(batch_page(batch, compare=compare), encoding='utf-8')
