"""The drops of several runs together, each once.

A drop is known by what it follows from (`RunDescription.sequence`) and its index: runs of one
sequence that overlap share drops, and a log may hold a drop twice. Runs of other seeds are other
drops. To count a drop twice would make intervals narrower than they are.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.simulation.run_description import RunDescription

RunPoses = tuple[RunDescription, RestingPoses]


@dataclass(frozen=True, eq=False)
class MergedDrops:
    """The drops of one sequence, each once.

    run : RunDescription
        Of the first piece that was given of the sequence.
    run_ids : tuple of str
        All runs that had a part, in the order in which they were given.
    poses : tuple of RestingPoses
        Ascending; drops are missing between one and the next.
    """

    run: RunDescription
    run_ids: tuple[str, ...]
    poses: tuple[RestingPoses, ...]

    def __len__(self) -> int:
        return sum(len(poses) for poses in self.poses)


def merge_drops(pieces: Iterable[RunPoses], *, any_engine: bool = False) -> list[MergedDrops]:
    """All drops of pieces of runs, each once, by sequence in the order in which these appear.

    Parameters
    ----------
    pieces : (RunDescription, RestingPoses) each
        Of one part and one set of conditions. They may overlap, repeat and leave gaps.
    any_engine : bool
        Allow runs of different engines, versions of them, or time steps.

    Raises
    ------
    InvalidValueError
        If a run is of another part or other conditions than the first, or, unless allowed, of
        another engine; if a drop ended otherwise in one piece than in another; if different
        engines made drops of the same start, which are not independent.
    """
    groups: dict[tuple[object, ...], list[RunPoses]] = {}
    first: RunDescription | None = None
    for run, poses in pieces:
        first = first or run
        _check_same(first, run, any_engine)
        groups.setdefault(run.sequence(), []).append((run, poses))
    merged = [_merge(group) for group in groups.values()]
    _check_starts(merged)
    return merged


def _check_same(first: RunDescription, run: RunDescription, any_engine: bool) -> None:
    """Raises InvalidValueError if drops of a run cannot be counted with those of the first."""
    compared = [('part_sha256', run.part_sha256, first.part_sha256)]
    here, there = run.conditions, first.conditions
    compared += [
        (name, str(getattr(here, name)), str(getattr(there, name))) for name in QUANTITIES
    ]
    compared.append(('height_of', here.height_of.name, there.height_of.name))
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
    """The drops of one sequence."""
    kept: list[RunPoses] = []
    end = 0
    # In the order of their drops, so that a piece can overlap only what was last kept.
    for run, poses in sorted(group, key=lambda piece: piece[1].first_drop):
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


def _joined(pieces: Sequence[RestingPoses]) -> list[RestingPoses]:
    """Ascending pieces, with those that touch made one."""
    gaps = [i for i, (a, b) in enumerate(pairwise(pieces), start=1) if a.end != b.first_drop]
    bounds = pairwise([0, *gaps, len(pieces)])
    return [RestingPoses.join(pieces[low:high]) for low, high in bounds if low < high]


def _check_equal(
    other: RunDescription, before: RestingPoses, run: RunDescription, poses: RestingPoses
) -> None:
    """Raises InvalidValueError if a drop that is in both did not end alike."""
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
    """(n,) whether anything of a drop differs in a bit, but for the bits of NaN."""
    found = np.zeros(len(a), dtype=bool)
    for field in fields(RestingPoses)[1:]:
        x, y = (np.atleast_2d(getattr(each, field.name).T) for each in (a, b))
        same = (x == y) & (np.signbit(x) == np.signbit(y)) | np.isnan(x) & np.isnan(y)
        found |= ~same.all(axis=0)
    return found


def _check_starts(merged: Sequence[MergedDrops]) -> None:
    """Raises InvalidValueError if two sequences have drops that started alike.

    The start of a drop follows from seed and index alone. Where two engines let the same start
    fall the ends are alike more often than by chance, and an interval takes drops as independent.
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
