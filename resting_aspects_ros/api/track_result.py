"""Results of a track: what its traps do to each orientation, and which traps to build."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from resting_aspects_ros.api.conditions import conditions_text
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.api.result import Result, write_rows
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.report.format import interval_text, numbers_text, share_text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.statistics.intervals import Interval, intervals
from resting_aspects_ros.tracks.design import Band
from resting_aspects_ros.tracks.orientations import AT_WALL, Orientation, mirror_images
from resting_aspects_ros.tracks.rate import Passage
from resting_aspects_ros.tracks.show import (
    band_table,
    interval_words,
    margin_text,
    outcome_fields,
    range_text,
    row_fields,
    row_table,
    rows_text,
    shown_rows,
    trap_table,
)
from resting_aspects_ros.tracks.simulate import TrackRuns
from resting_aspects_ros.tracks.traps import Cut, Trap, trap_text
from resting_aspects_ros.vision.outline import seen_outline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page


@dataclass(frozen=True, eq=False)
class TrackResult(Result):
    """What the traps of a track do to each orientation of a part, and how many good parts pass.

    Attributes
    ----------
    drop : DropResult
        The drops from which the shares of the aspects are.
    passage : Passage
        Rows, outcomes of the traps, and what follows from them.
    before : tuple of ReorientResult
        The actions that the parts undergo before the traps, in their order.
    runs : TrackRuns or None
        What became of simulated parts.
    interrupted : bool
        Whether parts should have been simulated, but were not.
    alike : tuple of int
        Of a design: ids of the wanted rows, and of those that its traps cannot separate from them.
    margin : float or None
        Of a design: its least margin, m.
    bands : tuple of (Trap, str, int, Band)
        Of a design by simulation: trap, its dimension, row, and the grey band.
    """

    drop: DropResult
    passage: Passage
    before: tuple[ReorientResult, ...] = ()
    runs: TrackRuns | None = None
    interrupted: bool = False
    alike: tuple[int, ...] = ()
    margin: float | None = None
    bands: tuple[tuple[Trap, str, int, Band], ...] = ()

    @property
    def part(self) -> Part:
        """The part."""
        return self.passage.part

    @property
    def rows(self) -> tuple[Orientation, ...]:
        """The orientations on the track, by their numbers."""
        return self.passage.rows

    @property
    def complete(self) -> bool:
        """Whether all drops, actions and runs are made."""
        return (
            self.drop.complete
            and all(each.complete for each in self.before)
            and not self.interrupted
        )

    @property
    def title(self) -> str:
        """Part, track and drops in lines."""
        surface = self.passage.track.surface
        actions = ''.join(f', then {each.action.name}' for each in self.before)
        return (
            f'{self.part.name} on a track of {1e3 * surface.width:g} mm, '
            f'{1e3 * self.passage.track.speed:g} mm/s\n'
            f'{self.drop.distribution.drops} drops on '
            f'{conditions_text(self.drop.run.conditions)}{actions}, seed {self.drop.run.seed}'
        )

    @property
    def trap_names(self) -> list[str]:
        """The traps in words, in their order."""
        return [trap_text(trap) for trap in self.passage.track.traps]

    @cached_property
    def mirrored(self) -> list[tuple[int, ...]]:
        """For each row, ids of the rows that are its mirror images along the track."""
        return mirror_images(self.rows, AT_WALL * self.part.hull_radius)

    @cached_property
    def row_intervals(self) -> list[Interval]:
        """Share of each row with the interval that follows from the number of drops and actions.

        After actions, the number of actions from each aspect counts.
        """
        counts = self.drop.distribution.counts
        number = int(counts.sum())
        shares = counts / max(number, 1)
        for each in self.before:
            shares = shares @ np.nan_to_num(each.matrix.transitions)
            number = min(number, int(each.matrix.actions.max()))
        found = []
        for row in self.rows:
            share = float(sum(shares[number_ - 1] for number_ in row.aspects))
            own = intervals([round(share * number)], number)[0]
            yaw = row.probability / share if share else 0.0
            low, high = min(own.lower, share), max(own.upper, share)
            found.append(Interval(row.probability, yaw * low, yaw * high))
        return found

    # -- Sentences --------------------------------------------------------------------------------

    @cached_property
    def sentences(self) -> list[str]:
        """What follows, and what limits it, in sentences."""
        found = [*self._rate_sentences(), *self._run_sentences(), *self._warnings()]
        return [*found, *filter(None, [self.drop.range_text])]

    def _rate_sentences(self) -> Iterator[str]:
        found = self.passage
        rows = rows_text(found.wanted)
        low, high = found.good
        if high == 0:
            if any(row.probability for row in found.rows if row.id in found.wanted):
                yield f'No part in {rows} passes the traps.{self._blocked()}'
            else:
                yield f'No part arrives in {rows}.'
            return
        rate, purity = found.rate, found.purity
        yield (
            f'{range_text(*rate, "good parts per minute")}: '
            f'{range_text(100 * low, 100 * high, "%")} of the parts pass in {rows}, with '
            f'{range_text(100 * purity[0], 100 * purity[1], "%")} purity.'
        )
        if found.model_good is not None:
            least, most = found.model_good
            good = range_text(found.arrivals * least, found.arrivals * most, 'per minute')
            yield (
                f'On a real surface, {interval_text(Interval(low, least, most))} of the parts '
                f'pass in {rows} (model range, with the friction of the wall): {good}.'
            )
        back = f'{range_text(*found.returned, "parts per minute")} fall back'
        if purity[0] < 1:
            others = range_text(*found.other_rows, 'parts per minute')
            yield f'{others} pass in other rows; {back}.'
        elif low > 0:
            passes = range_text(1 / high, 1 / low, 'passes')
            yield f'A good part needs {passes} of the traps on average; {back}.'

    def _blocked(self) -> str:
        """Return which trap stops the wanted row."""
        k = next(k for k, row in enumerate(self.rows) if row.id in self.passage.wanted)
        for number, of_trap in enumerate(self.passage.outcomes, 1):
            if of_trap[k].outcome != 'pass':
                return f' Trap {number}, {self.trap_names[number - 1]}: {of_trap[k].outcome}.'
        return ''

    def _run_sentences(self) -> Iterator[str]:
        runs, found = self.runs, self.passage
        if runs is None:
            return
        passed, total = runs.passed, runs.parts
        ids = [row.id for row in self.rows]
        groups = {
            'the wanted rows': np.isin(ids, found.wanted),
            'rows that are alike': np.isin(ids, sorted({*self.alike} - {*found.wanted})),
            'all others': ~np.isin(ids, [*found.wanted, *self.alike]),
        }
        shares = []
        for name, group in groups.items():
            if group.any():
                share = intervals([int(passed[group].sum())], int(group.sum()) * total)[0]
                shares.append(f'{interval_words(share)} of {name}')
        yield (
            f'Of {total} simulated parts of each row, these pass: {"; ".join(shares)}. That gives '
            f'{self.simulated_efficiency * found.arrivals:.1f} good parts per minute.'
        )
        jams = int(runs.jams.sum())
        if jams:
            rows = [row.id for row, n in zip(self.rows, runs.jams.tolist(), strict=True) if n]
            yield f'{jams} of the {len(ids) * total} simulated parts jam: {rows_text(rows)}.'
        for t, of_trap in enumerate(found.outcomes):
            rows = [
                row.id
                for k, row in enumerate(self.rows)
                if runs.agrees(t, k, of_trap[k].outcome) is False
            ]
            if rows:
                yield f'At trap {t + 1}, the simulation contradicts statics in {rows_text(rows)}.'
        by_statics = [k for k, each in enumerate(runs.simulated, 1) if not each]
        if by_statics:
            yield f'Trap {numbers_text(by_statics)} was not simulated; its stated outcomes count.'

    @property
    def simulated_efficiency(self) -> float:
        """Share of the parts that leave in a wanted row, by simulation; NaN without runs."""
        if self.runs is None:
            return float('nan')
        share = self.runs.passed / self.runs.parts
        mask = [row.id in self.passage.wanted for row in self.rows]
        return float((share * self.passage.probability)[mask].sum())

    @cached_property
    def flags(self) -> list[dict[str, object]]:
        """What limits the result, as flags with the ids of the rows."""
        found = self.passage
        limit = found.tolerance.both
        ends = list(zip(self.rows, found.ends, strict=True))
        close = {
            row.id
            for of_trap in found.outcomes
            for row, each in zip(self.rows, of_trap, strict=True)
            if abs(each.margin) < limit
        }
        rows = {
            'rolls': [row.id for row in self.rows if row.rolls],
            'unknown': [
                row.id for row, end in ends if end in ('unknown', 'turn') and not row.rolls
            ],
            'falls_off': [
                row.id
                for row, each in zip(self.rows, found.entry, strict=True)
                if each.outcome != 'pass'
            ],
            'jams': [row.id for row, end in ends if end == 'jam'],
            'margin_below_tolerance': sorted(close),
            'alike': list(self.alike) if len(self.alike) > 1 else [],
        }
        return [{'flag': name, 'orientations': ids} for name, ids in rows.items() if ids]

    def _warnings(self) -> Iterator[str]:
        found = self.passage
        texts = {
            'rolls': 'The part rolls in {}: its outcome is not known.',
            'unknown': 'Statics does not tell what becomes of {}: only edges of the part '
            'touch the track, it drops into the trap, or it turns over.',
            'falls_off': 'These fall off the track before the first trap: {}.',
            'jams': f'{share_text(found.jams)} % of the parts jam in a trap: {{}}.',
            'margin_below_tolerance': 'The margin of {} is less than the tolerances of part '
            f'and trap together, {margin_text(found.tolerance.both)}.',
            'alike': 'The {} are alike to these traps, as mirror images are: where one of them '
            'passes, all do.',
        }
        shown = {self.rows[k].id for k in shown_rows(found)}
        for flag in self.flags:
            given: Any = flag['orientations']
            ids = [number for number in given if number in shown]
            if ids:
                yield texts[str(flag['flag'])].format(rows_text(ids))
        lost = 1 - float(found.probability.sum())
        if self.before and lost > 5e-4:
            yield f'{share_text(lost)} % of the parts are in no aspect after the actions.'

    # -- Tables, documents, pictures --------------------------------------------------------------

    def tables(self) -> list[Table]:
        """Return the tables of the rows, of what each trap does to them, and of grey bands."""
        found = self.passage
        tables = [row_table(found, self.row_intervals, self.runs, self.title)]
        if found.outcomes:
            tables.append(trap_table(self.trap_names, found, self.runs))
        if self.bands:
            tables.append(
                band_table([(trap_text(t), name, row, band) for t, name, row, band in self.bands])
            )
        return tables

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects track --json` prints, in SI units."""
        found = self.passage
        run = self.drop.run.document()
        del run['precision']
        low, high = found.good
        return {
            'schema_version': SCHEMA_VERSION,
            **run,
            'mesh_sha256': self.part.mesh_sha256,
            'track': found.track.document,
            'before': [
                {'action': each.action.name, 'transitions': plain(each.matrix.transitions)}
                for each in self.before
            ],
            'orientations': self._row_fields(),
            'wanted': list(found.wanted),
            'traps': self._trap_fields(),
            'efficiency': [low, high],
            'purity': list(found.purity),
            'rate': list(found.rate),
            'model_efficiency': found.model_good and list(found.model_good),
            'no_model_range': self.drop.no_model_range or None,
            'arrivals': found.arrivals,
            'passes_per_part': [1 / each if each else None for each in (high, low)],
            'returned_per_minute': list(found.returned),
            'other_rows_per_minute': list(found.other_rows),
            'jams': found.jams,
            'simulated': self._simulated_fields(),
            'tolerance': {'part': found.tolerance.part, 'trap': found.tolerance.trap},
            'design': self._design_fields(),
            'flags': self.flags,
            'summary': self.sentences,
        }

    def _row_fields(self) -> list[dict[str, Any]]:
        low, high = self.passage.passing
        columns = zip(
            self.rows,
            self.row_intervals,
            self.mirrored,
            self.passage.entry,
            low,
            high,
            strict=True,
        )
        return [
            {
                **row_fields(row),
                'lower': share.lower,
                'upper': share.upper,
                'alike': list(alike),
                'on_track': entry.outcome,
                'passes': [float(least), float(most)],
            }
            for row, share, alike, entry, least, most in columns
        ]

    def _trap_fields(self) -> list[dict[str, Any]]:
        found = self.passage
        traps: Any = found.track.document['traps']
        return [
            {
                **trap,
                'results': [
                    {
                        **outcome_fields(row.id, found.outcomes[t][k]),
                        'simulated': None if self.runs is None else self._run_fields(t, k),
                    }
                    for k, row in enumerate(self.rows)
                ],
            }
            for t, trap in enumerate(traps)
        ]

    def _run_fields(self, t: int, k: int) -> dict[str, Any] | None:
        runs = self.runs
        assert runs is not None
        share = runs.share(t, k)
        if share is None or not runs.simulated[t]:
            return None
        passed, turned, rejected, jammed = runs.counts[t, k].tolist()
        return {
            'pass': passed,
            'turn': turned,
            'reject': rejected,
            'jam': jammed,
            'lower': share.lower,
            'upper': share.upper,
            'agrees': runs.agrees(t, k, self.passage.outcomes[t][k].outcome),
        }

    def _simulated_fields(self) -> dict[str, Any] | None:
        if self.runs is None:
            return None
        efficiency = self.simulated_efficiency
        return {
            'parts': self.runs.parts,
            'passed': self.runs.passed.tolist(),
            'jams': self.runs.jams.tolist(),
            'efficiency': efficiency,
            'rate': efficiency * self.passage.arrivals,
        }

    def _design_fields(self) -> dict[str, Any] | None:
        if self.margin is None:
            return None
        return {
            'margin': plain(self.margin),
            'alike': list(self.alike),
            'bands': [
                {
                    'trap': trap.kind,
                    'dimension': name,
                    'id': row,
                    'passes': plain(band.passes),
                    'rejects': plain(band.rejects),
                }
                for trap, name, row, band in self.bands
            ],
        }

    def save_csv(self, path: str | Path) -> None:
        """Write a line for each row, with what each trap does to it; raises OutputError."""
        lines = []
        for k, fields in enumerate(self._row_fields()):
            line = {name: _cell(value) for name, value in fields.items()}
            for t, of_trap in enumerate(self.passage.outcomes):
                name = f'trap_{t + 1}'
                line[f'{name}_outcome'] = of_trap[k].outcome
                line[f'{name}_margin'] = _cell(plain(of_trap[k].margin))
                if self.runs is not None:
                    share = self.runs.share(t, k)
                    line[f'{name}_simulated'] = '' if share is None else str(share.probability)
            lines.append(line)
        write_rows(Path(path), lines)

    def figure(self) -> 'Figure':
        """Return each orientation from above, with its contact, and whether it passes."""
        from resting_aspects_ros.tracks.show import rows_figure

        rows = [self.rows[k] for k in shown_rows(self.passage)]
        outlines = [self._outline(row) for row in rows]
        regions = [self._supported(row) for row in rows]
        return rows_figure(self.passage, outlines, regions)

    def page(self) -> 'Page':
        """Return a page with the rows, the track to scale, and where the parts go."""
        from resting_aspects_ros.api.track_page import track_page

        return track_page(self)

    def _outline(self, row: Orientation) -> shapely.Geometry:
        outline = seen_outline(self.part, row.orientation)
        return shapely.affinity.translate(outline, 0.0, row.yaw.distance)

    def _supported(self, row: Orientation) -> shapely.Geometry:
        """Return what still carries the row on the narrowest track that no trap interrupts, m."""
        area = self.passage.track.surface.area
        for trap in self.passage.track.traps:
            if isinstance(trap, Cut) and trap.span() is None:
                area = area.difference(trap.removed())
        return shapely.convex_hull(shapely.intersection(row.contact, area))

    def wanted_outline(self) -> shapely.Geometry:
        """Return the outline of the first wanted row from above, m, the wall at y = 0."""
        return self._outline(next(row for row in self.rows if row.id in self.passage.wanted))

    def cuts(self) -> list[shapely.Geometry | None]:
        """Return what each trap cuts out of the track, m; None: nothing."""
        return [
            trap.removed() if isinstance(trap, Cut) else None for trap in self.passage.track.traps
        ]


def _cell(value: Any) -> str:
    """Return a value of a CSV file: lists have spaces between their items."""
    if isinstance(value, list):
        return ' '.join(map(str, value))
    return '' if value is None else str(value)


@dataclass(frozen=True, eq=False)
class TrackDesign(Result):
    """Traps that pass only wanted orientations, or what cannot be separated from them.

    Attributes
    ----------
    designs : tuple of TrackResult
        The proposals, the one with the largest margin first; empty if no set of traps passes only
        the wanted rows. Only the bands of the first are simulated.
    bare : TrackResult
        The track without proposed traps.
    alike : tuple of int
        Ids of the wanted rows, and of those that no trap separates from them.
    advice : tuple of str
        What separates rows that these traps do not separate, in sentences.
    """

    designs: tuple[TrackResult, ...]
    bare: TrackResult
    alike: tuple[int, ...]
    advice: tuple[str, ...]

    @property
    def best(self) -> TrackResult:
        """The best design; the track without proposed traps if there is none."""
        return self.designs[0] if self.designs else self.bare

    @property
    def complete(self) -> bool:
        """Whether all drops, actions and runs are made."""
        return self.best.complete

    @cached_property
    def sentences(self) -> list[str]:
        """The proposals, what follows from the best one, and advice."""
        names = ['Best design', *['Alternative'] * len(self.designs)]
        proposals = [
            f'{name}: {"; ".join(each.trap_names) or "no trap"}; '
            + (
                f'margin {margin_text(each.margin)}.'
                if each.margin is not None and np.isfinite(each.margin)
                else 'no further trap is needed.'
            )
            for name, each in zip(names, self.designs, strict=False)
        ]
        return [*proposals, *self.best.sentences, *self.advice]

    def tables(self) -> list[Table]:
        """Return the tables of the best design."""
        return self.best.tables()

    def document(self) -> dict[str, object]:
        """Return the document of the best design, with all proposals."""
        found = self.best.document()
        proposals = [
            {'margin': plain(each.margin), 'traps': each.passage.track.document['traps']}
            for each in self.designs
        ]
        bands: Any = found['design'] or {'bands': []}
        return {
            **found,
            'design': {
                'proposals': proposals,
                'alike': list(self.alike),
                'bands': bands['bands'],
                'advice': list(self.advice),
            },
            'summary': self.sentences,
        }

    def save_csv(self, path: str | Path) -> None:
        """Write the rows of the best design; see TrackResult."""
        self.best.save_csv(path)

    def figure(self) -> 'Figure':
        """Return the picture of the best design."""
        return self.best.figure()

    def page(self) -> 'Page':
        """Return the page of the best design."""
        from resting_aspects_ros.api.track_page import track_page, verdicts

        page = track_page(self.best)
        return replace(page, top=verdicts(self.sentences, self.best.drop.range_text))
