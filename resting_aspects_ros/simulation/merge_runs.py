"""Merging the drops of several runs, so that each drop is counted once.

A drop is identified by the inputs that determine it (`RunDescription.sequence`) and its index.
Overlapping runs of one sequence share drops, and a log may contain a drop twice. Runs with
different seeds have different drops. Counting a drop twice would make the intervals too narrow.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.simulation.run_description import RunDescription

RunPoses = tuple[RunDescription, RestingPoses]


@dataclass(frozen=True, eq=False)
class MergedDrops:
    """The drops of one sequence, without duplicates.

    run : RunDescription
        Description of the first batch of the sequence.
    run_ids : tuple of str
        Ids of all runs that contributed, in input order.
    poses : tuple of RestingPoses
        Contiguous blocks, ascending, with missing drops between consecutive blocks.
    """

    run: RunDescription
    run_ids: tuple[str, ...]
    poses: tuple[RestingPoses, ...]

    def __len__(self) -> int:
        return sum(len(poses) for poses in self.poses)


def merge_drops(batches: Iterable[RunPoses], *, any_engine: bool = False) -> list[MergedDrops]:
    """Return the drops of all batches without duplicates, grouped by sequence in input order.

    Parameters
    ----------
    batches : iterable of (RunDescription, RestingPoses)
        Batches of one part and one set of conditions. They may overlap, repeat and have gaps.
    any_engine : bool
        Allow runs with different engines, engine versions or time steps.

    Raises
    ------
    InvalidValueError
        If a run has another part or other conditions than the first, or, unless allowed, another
        engine; if two batches contain different results for the same drop; if different engines
        simulated the same initial state, because such drops are not independent.
    """
    groups: dict[tuple[object, ...], list[RunPoses]] = {}
    first: RunDescription | None = None
    for run, poses in batches:
        first = first or run
        _check_same(first, run, any_engine)
        groups.setdefault(run.sequence(), []).append((run, poses))
    merged = [_merge(group) for group in groups.values()]
    _check_starts(merged)
    return merged


def _check_same(first: RunDescription, run: RunDescription, any_engine: bool) -> None:
    """Raise InvalidValueError if the run cannot be merged with the first one."""
    compared = [('part_sha256', run.part_sha256, first.part_sha256)]
    here, there = run.conditions, first.conditions
    compared += [
        (name, str(getattr(here, name)), str(getattr(there, name))) for name in QUANTITIES
    ]
    compared.append(('height_of', here.height_of.name, there.height_of.name))
    if here.surroundings != there.surroundings:
        compared.append(
            ('surroundings', shown(here.surroundings_key, 200), shown(there.surroundings_key, 200))
        )
    if not any_engine:
        compared.append(('engine', _engine(run), _engine(first)))
    for name, value, allowed in compared:
        if value != allowed:
            raise InvalidValueError(
                f'invalid {name} {value} of run {run.run_id}: expected {allowed}, as in run '
                f'{first.run_id}'
            )


def _engine(run: RunDescription) -> str:
    return f'{run.engine} {run.engine_version} in steps of {run.time_step!r} s'


def _merge(group: Sequence[RunPoses]) -> MergedDrops:
    """Merge the drops of one sequence."""
    kept: list[RunPoses] = []
    end = 0
    # Sorted by first drop, so that a batch can overlap only the batches that were kept last.
    for run, poses in sorted(group, key=lambda batch: batch[1].first_drop):
        for other, before in reversed(kept):
            if before.end <= poses.first_drop:
                break
            _check_equal(other, before, run, poses)
        if poses.end > end:
            new = poses.between(end, poses.end)
            if len(new):
                kept.append((run, new))
                end = new.end
    return MergedDrops(
        run=group[0][0],
        run_ids=tuple(dict.fromkeys(run.run_id for run, _ in group)),
        poses=tuple(_joined([poses for _, poses in kept])),
    )


def _joined(blocks: Sequence[RestingPoses]) -> list[RestingPoses]:
    """Join adjacent blocks of an ascending sequence."""
    gaps = [i for i, (a, b) in enumerate(pairwise(blocks), start=1) if a.end != b.first_drop]
    bounds = pairwise([0, *gaps, len(blocks)])
    return [RestingPoses.join(blocks[low:high]) for low, high in bounds if low < high]


def _check_equal(
    other: RunDescription, before: RestingPoses, run: RunDescription, poses: RestingPoses
) -> None:
    """Raise InvalidValueError if a drop that is in both has different results."""
    low, high = max(before.first_drop, poses.first_drop), min(before.end, poses.end)
    differs = _differ(before.between(low, high), poses.between(low, high))
    if differs.any():
        drop = low + int(differs.argmax())
        raise InvalidValueError(
            f'drop {drop} of seed {run.seed} has different results in run {run.run_id} and in run '
            f'{other.run_id}: expected identical bits; one of the runs was simulated on another '
            'platform, or its log is damaged'
        )


def _differ(a: RestingPoses, b: RestingPoses) -> npt.NDArray[np.bool_]:
    """Return, (n,), whether any value of a drop differs in a bit; all NaN count as equal."""
    differs = np.zeros(len(a), dtype=bool)
    for field in fields(RestingPoses)[1:]:
        x, y = (np.atleast_2d(getattr(each, field.name).T) for each in (a, b))
        same = (x == y) & (np.signbit(x) == np.signbit(y)) | np.isnan(x) & np.isnan(y)
        differs |= ~same.all(axis=0)
    return differs


def _check_starts(merged: Sequence[MergedDrops]) -> None:
    """Raise InvalidValueError if two sequences have drops with the same initial state.

    The initial state depends only on the seed and the index. The results of two engines for the
    same initial state agree more often than by chance, but the intervals assume independent drops.
    """
    ranges = sorted(
        (each.run.seed, poses.first_drop, poses.end, each.run.run_id)
        for each in merged
        for poses in each.poses
    )
    for (seed, _, end, one), (next_seed, first, _, other) in pairwise(ranges):
        if seed == next_seed and first < end:
            raise InvalidValueError(
                f'drop {first} of seed {seed} is in run {one} and in run {other}, which differ in '
                'engine, version or timestep: expected different seeds or drops, because drops '
                'with the same initial state are not independent'
            )
