"""What passes the traps of a track, and which traps pass only a wanted orientation."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.api.model_range import OF_ACTIONS
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.reorient import reorient
from resting_aspects_ros.api.runner import (
    DropProgress,
    Progress,
    given_workers,
    keep_result,
    never,
)
from resting_aspects_ros.api.track_result import TrackResult
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, StoppedError, shown, warn
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
    quantities_of,
)
from resting_aspects_ros.simulation.starts import Action, States
from resting_aspects_ros.simulation.workers import Workers, call_each
from resting_aspects_ros.system import config_folder
from resting_aspects_ros.tracks.description import Track, read_track, read_track_file
from resting_aspects_ros.tracks.design import (
    MAX_TRAPS,
    Asked,
    Band,
    DesignResult,
    asymmetric_cut,
    design_traps,
)
from resting_aspects_ros.tracks.orientations import Orientation, orientations_on
from resting_aspects_ros.tracks.rate import Passage, Tolerance, confusion, pass_traps
from resting_aspects_ros.tracks.show import margin_text, rows_text
from resting_aspects_ros.tracks.simulate import (
    CHUNK,
    Run,
    measured_band,
    run_parts,
    run_track,
)
from resting_aspects_ros.tracks.traps import Sensor, Surface, Trap, trap_text
from resting_aspects_ros.vision.outline import seen_outline

DROPS = 2000
MAX_PARTS = 100_000
# Dimensions of a trap beyond these multiples of the size of the part are probably in a wrong unit.
PLAUSIBLE = 0.002, 20.0
# A camera that resolves this, m, separates outlines that differ by more.
RESOLVED = 3e-4


def track(
    part: Part | str | Path,
    on: Track | Mapping[str, Any] | str | Path,
    want: int | Sequence[int] = (),
    *,
    simulate: int = 0,
    before: Sequence[str | Action | NamedAction] = (),
    drops: int = DROPS,
    surface: str | DropConditions = DEFAULT_SURFACE,
    tolerance: float = 0.0,
    trap_tolerance: float = 0.0,
    seed: int = DEFAULT_SEED,
    model_range: bool = True,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> TrackResult:
    """Tell which orientations of a part pass the traps of a track, and how many good parts come.

    The shares of the aspects are those of drops on the surface. Pushing along the wall gives the
    share of each yaw in an aspect, and statics what a trap does; see docs/explanation/track.md.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    on : Track, mapping, str or Path
        A track, its description as of a YAML file, such a file, or the name of one in
        config/tracks.
    want : int or sequence of int
        Ids of the rows that the feeder shall deliver; by default the first one that the
        track supports and a part arrives in.
    simulate : int
        Parts of each row that run over the traps at the speed of the track in Bullet; 0: none.
    before : sequence of str, action or NamedAction
        Actions that the parts undergo before the traps, in their order, as for `reorient`. They
        change the shares of the aspects by their transition matrices.
    drops : int
        Number of drops for the shares of the aspects.
    tolerance, trap_tolerance : float
        Half widths of the dimensions of parts and of traps, m.
    surface, seed, model_range, workers, progress, stopped, conditions
        As for `drop`. After actions, the model range of the rows is not known.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the track does not support a wanted row.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> trap = {'kind': 'wiper', 'height': '12.7mm'}
    >>> found = ra.track('hex_nut', {'width': '40mm', 'traps': [trap]}, drops=200)
    >>> [each.outcome for each in found.passage.outcomes[0]]
    ['pass', 'reject', 'reject']
    """
    given, wanted = given_track(on), tuple(want) if isinstance(want, Iterable) else (want,)
    limits = Tolerance(tolerance, trap_tolerance)
    _check_parts(simulate)
    loaded = given_part(part)
    _warn_of_units(loaded, given)
    options: dict[str, Any] = {
        'surface': surface,
        'drops': drops,
        'seed': seed,
        'workers': workers,
        'progress': progress,
        'stopped': stopped,
        **conditions,
    }
    actions = [named_action(each) for each in before]
    dropped = drop(loaded, model_range=model_range and not actions, **options)
    if actions and model_range:
        dropped = replace(dropped, no_model_range=OF_ACTIONS)
    acted = tuple(reorient(loaded, action, **options) for action in actions)
    distribution, wall = dropped.distribution, given.wall
    shares: Array = distribution.counts / max(int(distribution.counts.sum()), 1)
    for each in acted:
        shares = shares @ np.nan_to_num(each.matrix.transitions)
    rows = orientations_on(
        loaded,
        distribution.aspects,
        shares.tolist(),
        wall.height,
        wall.friction,
        None if distribution.model is None else distribution.model.by_aspect,
    )
    confusions = _confusions(loaded, rows, given, dropped, seed)
    passage = pass_traps(loaded, rows, given, wanted, limits, confusions)
    result = TrackResult(dropped, passage, acted)
    return _with_runs(result, simulate, seed, workers, progress, stopped)


def design_track(
    part: Part | str | Path,
    want: int | Sequence[int] = (),
    on: Track | Mapping[str, Any] | str | Path | None = None,
    *,
    traps: int = MAX_TRAPS,
    simulate: int = 0,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **options: Any,
) -> TrackResult:
    """Propose traps that pass only wanted orientations of a part, with the largest margins.

    Parameters
    ----------
    on : Track, mapping, str or Path, optional
        The track, as for `track`; by default one twice as wide as the part, rolled towards the
        wall by 5 degrees. Its own traps stay, and the proposed ones follow them.
    traps : int
        Maximum number of proposed traps, 1 to 3.
    simulate : int
        As for `track`, with the best design. Its margins are then those from the grey band of each
        trap and row, in which only some of the parts pass at the speed of the track.
    part, want, seed, workers, progress, stopped, options
        As for `track`.

    Returns
    -------
    TrackResult
        With the traps of the best design. ``design.designs`` has all of them, the one with the
        largest margin first; none if no set of traps passes only the wanted rows, and then
        ``advice`` tells what would separate the others.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, the part rolls in a wanted row, or the track
        does not support it.
    """
    _check_parts(simulate)
    loaded = given_part(part)
    given = default_track(loaded) if on is None else on
    asked: dict[str, Any] = {
        'seed': seed,
        'workers': workers,
        'progress': progress,
        'stopped': stopped,
    }
    bare = track(loaded, given, want, **asked, **options)
    physics = bare.drop.run.conditions

    kept = replace(bare, interrupted=True)
    with keep_result(lambda: kept), _simulation(workers, stopped) as run:

        def band(asked: Asked) -> Band:
            try:
                return measured_band(loaded, *asked, bare.passage.track, physics, seed, run)
            except StoppedError:
                return Band(asked.critical, asked.critical)

        def measure(asked: Sequence[Asked]) -> list[Band]:
            found, what = [], f'{loaded.name}, grey bands'
            with DropProgress(what, len(asked), 'bands', shown=progress) as bar:
                for number, each in enumerate(asked, start=1):
                    found.append(band(each))
                    bar.update(number)
            return found

        found = design_traps(bare.passage, traps, measure if simulate else None)
    advice = tuple(_advice(bare.passage, found))
    if not found.designs:
        stopped_early = bool(simulate) and stopped()
        return replace(bare, design=found, advice=advice, interrupted=stopped_early)
    best = replace(bare, passage=found.designs[0].passage, design=found, advice=advice)
    return _with_runs(best, simulate, seed, workers, progress, stopped)


def default_track(part: Part) -> Track:
    """Return a track that is wide enough for the part, rolled towards the wall by 5 degrees."""
    width = round(2 * part.hull_radius + 0.01, 3)
    return read_track({'width': width, 'roll': '5deg'})


def given_track(on: Track | Mapping[str, Any] | str | Path) -> Track:
    """Return a track, or that of a mapping, a file, or a name in config/tracks."""
    if isinstance(on, Track):
        return on
    if not isinstance(on, str | Path):
        return read_track(on)
    path = Path(on)
    if path.suffix not in ('.yaml', '.yml'):
        folder = config_folder() / 'tracks'
        names = sorted(file.stem for file in folder.glob('*.yaml'))
        if str(on) not in names:
            raise InvalidValueError(
                f'invalid track {str(on)!r}: expected a YAML file, or one of {", ".join(names)}'
            )
        path = folder / f'{on}.yaml'
    return read_track_file(path)


# -- Parts of the computation -----------------------------------------------------------------


def _confusions(
    part: Part, rows: Sequence[Orientation], on: Track, dropped: DropResult, seed: int
) -> dict[Sensor, Array]:
    """Return the confusion matrix of each sensor of the track."""
    sensors = {trap for trap in on.traps if isinstance(trap, Sensor)}
    if not sensors:
        return {}
    known = known_part(part, dropped)
    return {sensor: confusion(known, rows, sensor.noise, seed) for sensor in sensors}


@contextmanager
def _simulation(
    workers: int | Workers | None,
    stopped: Callable[[], bool],
    ran: Callable[[int], None] = lambda _: None,
) -> Iterator[Run]:
    """Yield what runs parts in the processes of workers; it raises StoppedError if it is stopped.

    ran : callable
        Called often with the number of all parts that have run.
    """
    with given_workers(workers) as pool:
        before = 0

        def waiting(chunks: int) -> None:
            ran(before + chunks * CHUNK)
            if stopped():
                raise StoppedError('interrupted: parts were running over a trap')

        def run(calls: Sequence[tuple[Any, ...]]) -> Sequence[States]:
            nonlocal before
            waiting(0)
            found = call_each(pool, run_parts, calls, 'at a trap', waiting)
            before += sum(len(each.position) for each in found)
            ran(before)
            return found

        yield run


def _with_runs(
    result: TrackResult,
    parts: int,
    seed: int,
    workers: int | Workers | None,
    progress: Progress,
    stopped: Callable[[], bool],
) -> TrackResult:
    """Return the result with simulated parts."""
    if not parts or not result.passage.track.traps:
        return result
    physics = result.drop.run.conditions
    on = result.passage
    total = parts * len(on.rows) * len(on.track.traps)
    stopped_here = replace(result, interrupted=True)
    with (
        DropProgress(f'{on.part.name}, traps', total, 'parts', shown=progress) as bar,
        keep_result(lambda: stopped_here),
    ):
        try:
            with _simulation(workers, stopped, lambda n: bar.update(min(n, total))) as run:
                runs = run_track(on, physics, parts, seed, run)
        except StoppedError:
            return stopped_here
        bar.end(bar.done)
    return replace(result, runs=runs)


def _check_parts(simulate: int) -> None:
    whole = isinstance(simulate, int) and not isinstance(simulate, bool)
    if not (whole and 0 <= simulate <= MAX_PARTS):
        raise InvalidValueError(
            f'invalid number of simulated parts {shown(simulate)}: expected 0 to {MAX_PARTS}'
        )


def _warn_of_units(part: Part, on: Track) -> None:
    """Warn of dimensions that are so far from the size of the part that the unit is in doubt."""
    size = 2 * part.hull_radius
    low, high = (factor * size for factor in PLAUSIBLE)
    described: list[tuple[str, Surface | Trap]] = [('track', on.surface)]
    described += [(trap_text(each), each) for each in on.traps]
    for what, of in described:
        for name, each in quantities_of(of).items():
            value = getattr(of, name)
            default = type(of).__dataclass_fields__[name].default
            if each.unit != 'm' or not value or value == default or name == 'noise':
                continue
            if not low <= value <= high:
                warn(
                    f'the {each.label} of {1e3 * value:g} mm ({what}) is far from the size of '
                    f'{part.name}, {1e3 * size:.3g} mm: numbers without a unit are in m; write '
                    '12mm for millimetres'
                )


# -- Advice ---------------------------------------------------------------------------------------


def _advice(on: Passage, found: DesignResult) -> Iterator[str]:
    """Yield what separates rows that the traps do not separate."""
    wanted = rows_text(on.wanted)
    if not found.designs:
        yield (
            f'No set of traps passes only {wanted}'
            + (
                f': no trap that passes it also rejects {rows_text(found.remaining)}.'
                if found.remaining
                else ' with a margin of 0.1 mm.'
            )
        )
        if found.others:
            texts = [f'{number} (margin {margin_text(margin)})' for number, margin in found.others]
            by = ', by statics' if found.bands else ''
            yield f'Traps exist for these wanted rows{by}: {", ".join(texts[:3])}.'
        for kind in sorted({trap.kind for trap, *_ in found.bands}):
            failed = [
                row
                for trap, _, row, band in found.bands
                if trap.kind == kind and math.inf in (band.passes, band.rejects)
            ]
            if failed:
                yield (
                    f'Simulated at {1e3 * on.track.speed:g} mm/s, no {kind} within 16 mm of its '
                    f'critical value passes or rejects {rows_text(sorted({*failed}))} as '
                    'statics says: its parts jam or turn.'
                )
    by_id = {row.id: row for row in on.rows}
    mixed = [number for number in found.alike if number not in on.wanted]
    for other in [*mixed, *found.remaining]:
        cut = asymmetric_cut(on, other)
        if cut is not None:
            corners = ', '.join(
                f'({1e3 * cut[0].scale * x:.1f}, {1e3 * cut[0].scale * y:.1f})'
                for x, y in cut[0].points
            )
            yield (
                f'A triangular cut-out with the corners {corners} mm (along the track, from the '
                f'wall) passes {wanted} and rejects row {other}, with a margin of '
                f'{margin_text(cut[1])}.'
            )
        elif all(_camera_separates(on.part, by_id[each], by_id[other]) for each in on.wanted):
            yield f'A camera (a sensor) separates {wanted} from row {other}.'
        else:
            yield f'No triangular cut-out and no camera separates {wanted} from row {other}.'


def _camera_separates(part: Part, one: Orientation, other: Orientation) -> bool:
    """Return whether the outlines of two rows differ where the wall is, from above."""
    outlines = [
        shapely.transform(
            seen_outline(part, row.orientation), lambda points: points - points.min(axis=0)
        )
        for row in (one, other)
    ]
    return bool(shapely.hausdorff_distance(*outlines) > RESOLVED)
