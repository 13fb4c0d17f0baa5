"""What passes the traps of a track, and which traps pass only a wanted orientation."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import shapely

from resting_aspects_ros.api.conditions import conditions_text
from resting_aspects_ros.api.drop import drop
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import Progress, never
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION
from resting_aspects_ros.report.format import numbers_text, share_text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    DropConditions,
    config_folder,
)
from resting_aspects_ros.simulation.job import DEFAULT_SEED
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.track.description import Track, read_track, read_track_file
from resting_aspects_ros.track.design import MOST_TRAPS, design_traps
from resting_aspects_ros.track.orientations import Orientation, orientations_on
from resting_aspects_ros.track.rate import Passage, Tolerance, pass_traps
from resting_aspects_ros.track.show import (
    margin_text,
    outcome_fields,
    range_text,
    row_fields,
    row_table,
    trap_table,
)
from resting_aspects_ros.track.traps import Cut, trap_text
from resting_aspects_ros.vision.outline import seen_outline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page

DROPS = 2000


@dataclass(frozen=True, eq=False)
class TrackResult(Result):
    """What the traps of a track do to each orientation of a part, and how many good parts pass.

    Attributes
    ----------
    drop : DropResult
        The drops from which the shares of the aspects are.
    passage : Passage
        Rows, outcomes of the traps, and what follows from them.
    alike : tuple of int
        Of a design: ids of the rows that its traps cannot separate from the wanted one.
    margin : float or None
        Of a design: its least margin, m.
    """

    drop: DropResult
    passage: Passage
    alike: tuple[int, ...] = ()
    margin: float | None = None

    @property
    def part(self) -> Part:
        """The part."""
        return self.passage.part

    @property
    def rows(self) -> tuple[Orientation, ...]:
        """The orientations on the track, the most probable one first."""
        return self.passage.rows

    @property
    def complete(self) -> bool:
        """Whether all drops are made."""
        return self.drop.complete

    @property
    def title(self) -> str:
        """Part, track and drops in lines."""
        surface = self.passage.track.surface
        return (
            f'{self.part.name} on a track of {1e3 * surface.width:g} mm, '
            f'{1e3 * self.passage.track.speed:g} mm/s\n'
            f'{self.drop.distribution.drops} drops on '
            f'{conditions_text(self.drop.run.conditions)}, seed {self.drop.run.seed}'
        )

    @property
    def trap_names(self) -> list[str]:
        """The traps in words, in their order."""
        return [trap_text(trap) for trap in self.passage.track.traps]

    @cached_property
    def sentences(self) -> list[str]:
        """What follows, and what limits it, in sentences."""
        return [*self._rate_sentences(), *self._warnings()]

    def _rate_sentences(self) -> Iterator[str]:
        found = self.passage
        wanted = numbers_text(found.wanted)
        low, high = found.good
        if high == 0:
            yield f'No part in row {wanted} passes the traps.'
            return
        rate, purity = found.rate, found.purity
        yield (
            f'{range_text(*rate, "good parts per minute")}: '
            f'{range_text(100 * low, 100 * high, "%")} of the parts pass in row {wanted}, with '
            f'{range_text(100 * purity[0], 100 * purity[1], "%")} purity.'
        )
        if low > 0:
            yield (
                f'A good part needs {range_text(1 / high, 1 / low, "passes")} of the traps on '
                'average; the others fall back.'
            )

    def _warnings(self) -> Iterator[str]:
        found = self.passage
        if found.jams > 0:
            yield f'{share_text(found.jams)} % of the parts jam in a trap.'
        unknown = [row.id for row in self.rows if row.rolls]
        if unknown:
            yield f'The part rolls in row {numbers_text(unknown)}: its outcome is not known.'
        ends = zip(self.rows, self._ends(), strict=True)
        uncertain = [row.id for row, end in ends if end in ('unknown', 'turn') and not row.rolls]
        if uncertain:
            yield (
                f'Statics does not tell what becomes of row {numbers_text(uncertain)}: only edges '
                'of the part touch the track, or it turns over.'
            )
        limit = found.tolerance.both
        close = sorted(
            {
                row.id
                for of_trap in found.outcomes
                for row, each in zip(self.rows, of_trap, strict=True)
                if abs(each.margin) < limit
            }
        )
        if close:
            yield (
                f'The margin of row {numbers_text(close)} is less than the tolerances of part and '
                f'trap together, {margin_text(limit)}.'
            )
        if len(self.alike) > 1:
            yield (
                f'Rows {numbers_text(self.alike)} are alike to these traps, as mirror images are: '
                'an asymmetric cut-out or a camera separates them.'
            )

    def tables(self) -> list[Table]:
        """Return the tables of the rows, and of what each trap does to them."""
        found = self.passage
        tables = [row_table(self.rows, found.wanted, found.passing, self.title)]
        if found.outcomes:
            tables.append(trap_table(self.rows, self.trap_names, found.outcomes))
        return tables

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects track --json` prints, in SI units."""
        found = self.passage
        run = self.drop.run.document()
        del run['precision']
        traps: Any = found.track.document['traps']
        return {
            'schema_version': SCHEMA_VERSION,
            **run,
            'mesh_sha256': self.part.mesh_sha256,
            'track': found.track.document,
            'orientations': [row_fields(row) for row in self.rows],
            'wanted': list(found.wanted),
            'alike': list(self.alike),
            'traps': [
                {
                    **trap,
                    'results': [
                        outcome_fields(row.id, each)
                        for row, each in zip(self.rows, of_trap, strict=True)
                    ],
                }
                for trap, of_trap in zip(traps, found.outcomes, strict=True)
            ],
            'design_margin': self.margin,
            'efficiency': list(found.good),
            'purity': list(found.purity),
            'rate': list(found.rate),
            'arrivals': found.arrivals,
            'jams': found.jams,
            'tolerance': {'part': found.tolerance.part, 'trap': found.tolerance.trap},
            'summary': self.sentences,
        }

    def figure(self) -> 'Figure':
        """Return each orientation from above, with its contact, and whether it passes."""
        from resting_aspects_ros.track.show import rows_figure

        outlines = [self._outline(row) for row in self.rows]
        return rows_figure(self.rows, outlines, self._ends(), self.passage.wanted)

    def page(self) -> 'Page':
        """Return a page with the rows, the track to scale, and where the parts go."""
        from resting_aspects_ros.api.track_page import track_page

        return track_page(self)

    def _ends(self) -> list[str]:
        """Return what becomes of each row: the first outcome that is no pass."""
        ends = []
        for k in range(len(self.rows)):
            of_row = [of_trap[k].outcome for of_trap in self.passage.outcomes]
            ends.append(next((each for each in of_row if each != 'pass'), 'pass'))
        return ends

    def _outline(self, row: Orientation) -> shapely.Geometry:
        outline = seen_outline(self.part, row.orientation)
        return shapely.affinity.translate(outline, 0.0, row.yaw.distance)

    def wanted_outline(self) -> shapely.Geometry:
        """Return the outline of the first wanted row from above, m, the wall at y = 0."""
        return self._outline(next(row for row in self.rows if row.id in self.passage.wanted))

    def cuts(self) -> list[shapely.Geometry | None]:
        """Return what each trap cuts out of the track, m; None: nothing."""
        return [
            trap.removed() if isinstance(trap, Cut) else None for trap in self.passage.track.traps
        ]


def track(
    part: Part | str | Path,
    on: Track | Mapping[str, Any] | str | Path,
    want: int | Sequence[int] = (),
    *,
    drops: int = DROPS,
    surface: str | DropConditions = DEFAULT_SURFACE,
    tolerance: float = 0.0,
    trap_tolerance: float = 0.0,
    seed: int = DEFAULT_SEED,
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
        Ids of the rows that the feeder shall deliver; by default the most probable one.
    drops : int
        Number of drops for the shares of the aspects.
    tolerance, trap_tolerance : float
        Half widths of the dimensions of parts and of traps, m.
    surface, seed, workers, progress, stopped, conditions
        As for `drop`.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, or a name is not known.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> trap = {'kind': 'wiper', 'height': '12.7mm'}
    >>> found = ra.track('hex_nut', {'width': '40mm', 'traps': [trap]}, drops=200)
    >>> [each.outcome for each in found.passage.outcomes[0]]
    ['pass', 'reject', 'reject']
    """
    given, wanted = given_track(on), (want,) if isinstance(want, int) else tuple(want)
    limits = Tolerance(tolerance, trap_tolerance)
    dropped = drop(
        given_part(part),
        drops,
        surface=surface,
        seed=seed,
        model_range=False,
        workers=workers,
        progress=progress,
        stopped=stopped,
        **conditions,
    )
    rows = _rows(dropped, given)
    return TrackResult(dropped, pass_traps(_part(dropped), rows, given, wanted, limits))


def design_track(
    part: Part | str | Path,
    want: int,
    on: Track | Mapping[str, Any] | str | Path | None = None,
    *,
    traps: int = MOST_TRAPS,
    drops: int = DROPS,
    surface: str | DropConditions = DEFAULT_SURFACE,
    tolerance: float = 0.0,
    trap_tolerance: float = 0.0,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> list[TrackResult]:
    """Propose traps that pass only a wanted orientation of a part, with the largest margins.

    Parameters
    ----------
    want : int
        Id of the row that the feeder shall deliver; `track` shows the rows.
    on : Track, mapping, str or Path, optional
        The track without traps, as for `track`; by default one twice as wide as the part, rolled
        towards the wall by 5 degrees.
    traps : int
        Maximum number of traps, 1 to 3.
    part, drops, surface, tolerance, trap_tolerance, seed, workers, progress, stopped, conditions
        As for `track`.

    Returns
    -------
    list of TrackResult
        The best proposals, the one with the largest margin first; empty if no set of traps passes
        only the wanted row.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the part rolls in the wanted row.
    """
    loaded = given_part(part)
    given = default_track(loaded) if on is None else replace(given_track(on), traps=())
    limits = Tolerance(tolerance, trap_tolerance)
    dropped = drop(
        loaded,
        drops,
        surface=surface,
        seed=seed,
        model_range=False,
        workers=workers,
        progress=progress,
        stopped=stopped,
        **conditions,
    )
    found = design_traps(loaded, _rows(dropped, given), given, want, limits, traps)
    return [
        TrackResult(dropped, design.passage, found.alike, design.margin)
        for design in found.designs
    ]


def default_track(part: Part) -> Track:
    """Return a track that is wide enough for the part, rolled towards the wall by 5 degrees."""
    width = round(2 * part.hull_radius + 0.01, 3)
    return read_track({'width': width, 'roll': '5deg'})


def given_track(on: Track | Mapping[str, Any] | str | Path) -> Track:
    """Return a track, or that of a mapping, a file, or a name in config/tracks."""
    if isinstance(on, Track):
        return on
    if isinstance(on, Mapping):
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


def _rows(dropped: DropResult, on: Track) -> list[Orientation]:
    distribution = dropped.distribution
    total = max(int(distribution.counts.sum()), 1)
    shares = [count / total for count in distribution.counts.tolist()]
    wall = on.wall
    return orientations_on(
        _part(dropped), distribution.aspects, shares, wall.height, wall.friction
    )


def _part(dropped: DropResult) -> Part:
    assert dropped.part is not None
    return dropped.part
