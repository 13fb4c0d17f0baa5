"""The result of a track: what its traps do to each orientation, and which traps to build."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

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
from resting_aspects_ros.simulation.conditions import quantities_of
from resting_aspects_ros.statistics.intervals import Interval, intervals
from resting_aspects_ros.tracks.design import Band, DesignResult
from resting_aspects_ros.tracks.orientations import AT_WALL, Orientation, mirror_images
from resting_aspects_ros.tracks.rate import Passage
from resting_aspects_ros.tracks.show import (
    band_table,
    flow_figure,
    interval_words,
    margin_text,
    range_text,
    row_fields,
    row_table,
    rows_figure,
    rows_text,
    shown_rows,
    track_figure,
    trap_table,
)
from resting_aspects_ros.tracks.simulate import TrackRuns
from resting_aspects_ros.tracks.traps import Cut, Trap, trap_text, value_text
from resting_aspects_ros.vision.outline import seen_outline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Item, Page

PAGE, FIGURES = 'track.html', ('orientations', 'track', 'flow')
MANY_ROWS = 12  # a longer table of the traps is shown on request
# Sentences of the flags, with the rows.
_FLAGS = {
    'rolls': 'The part rolls in {}: its outcome is not known.',
    'unknown': 'Statics does not tell what becomes of {}: only edges of the part touch the track, '
    'it drops into the trap, or it turns over.',
    'falls_off': 'These fall off the track before the first trap: {}.',
    'jams': '{jams} % of the parts jam in a trap: {}.',
    'margin_below_tolerance': 'The margin of {} is less than the tolerances of part and trap '
    'together, {tolerance}.',
    'alike': 'The {} are alike to these traps, as mirror images are: where one of them passes, '
    'all do.',
}


@dataclass(frozen=True, eq=False)
class TrackResult(Result):
    """What the traps of a track do to each orientation of a part, and how many good parts pass.

    Attributes
    ----------
    drop : DropResult
        The drops from which the shares of the aspects are.
    passage : Passage
        Rows, outcomes of the traps, and what follows from them; with the traps of the best design,
        if there is one.
    before : tuple of ReorientResult
        The actions that the parts undergo before the traps, in their order.
    runs : TrackRuns or None
        What became of simulated parts.
    interrupted : bool
        Whether parts should have been simulated, but were not.
    design : DesignResult or None
        The designs that `design_track` found, the one with the largest margin first. Only the
        bands of the first are simulated.
    advice : tuple of str
        What separates rows that these designs do not separate, in sentences.
    """

    drop: DropResult
    passage: Passage
    before: tuple[ReorientResult, ...] = ()
    runs: TrackRuns | None = None
    interrupted: bool = False
    design: DesignResult | None = None
    advice: tuple[str, ...] = ()

    @property
    def part(self) -> Part:
        """The part."""
        return self.passage.part

    @property
    def rows(self) -> tuple[Orientation, ...]:
        """The orientations on the track, by their numbers."""
        return self.passage.rows

    @property
    def alike(self) -> tuple[int, ...]:
        """Of a design: ids of the wanted rows, and of those that no trap separates from them."""
        return self.design.alike if self.design is not None and self.design.designs else ()

    @property
    def bands(self) -> tuple[tuple[Trap, str, int, Band], ...]:
        """Of a design by simulation: trap, its dimension, row, and the grey band."""
        return () if self.design is None else self.design.bands

    @property
    def complete(self) -> bool:
        """Whether all drops, actions and runs are made."""
        acted = all(each.complete for each in self.before)
        return self.drop.complete and acted and not self.interrupted

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
            share = float(sum(shares[aspect - 1] for aspect in row.aspects))
            own = intervals([round(share * number)], number)[0]
            yaw = row.probability / share if share else 0.0
            low, high = min(own.lower, share), max(own.upper, share)
            found.append(Interval(row.probability, yaw * low, yaw * high))
        return found

    # -- Sentences --------------------------------------------------------------------------------

    @cached_property
    def sentences(self) -> list[str]:
        """The designs, what follows from the traps, and what limits it, in sentences."""
        return [
            *self._design_sentences(),
            *self._rate_sentences(),
            *self._run_sentences(),
            *self._warnings(),
            *filter(None, [self.drop.range_text]),
            *self.advice,
        ]

    def _design_sentences(self) -> Iterator[str]:
        for k, each in enumerate(self.design.designs if self.design is not None else ()):
            traps = '; '.join(map(trap_text, each.passage.track.traps)) or 'no trap'
            margin = 'no further trap is needed'
            if np.isfinite(each.margin):
                margin = f'margin {margin_text(each.margin)}'
            yield f'{"Alternative" if k else "Best design"}: {traps}; {margin}.'

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
        purity = found.purity
        yield (
            f'{range_text(*found.rate, "good parts per minute")}: '
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
        """Return which trap stops the first wanted row."""
        k = next(k for k, row in enumerate(self.rows) if row.id in self.passage.wanted)
        for number, of_trap in enumerate(self.passage.outcomes, 1):
            if of_trap[k].outcome != 'pass':
                return f' Trap {number}, {self.trap_names[number - 1]}: {of_trap[k].outcome}.'
        return ''

    def _run_sentences(self) -> Iterator[str]:
        runs, found = self.runs, self.passage
        if runs is None:
            return
        ids = [row.id for row in self.rows]
        groups = {
            'the wanted rows': np.isin(ids, found.wanted),
            'rows that are alike': np.isin(ids, sorted({*self.alike} - {*found.wanted})),
            'all others': ~np.isin(ids, [*found.wanted, *self.alike]),
        }
        shares = []
        for name, group in groups.items():
            if group.any():
                passed, total = int(runs.passed[group].sum()), int(group.sum()) * runs.parts
                shares.append(f'{interval_words(intervals([passed], total)[0])} of {name}')
        yield (
            f'Of {runs.parts} simulated parts of each row, these pass: {"; ".join(shares)}. That '
            f'gives {self.simulated_efficiency * found.arrivals:.1f} good parts per minute.'
        )
        if jams := int(runs.jams.sum()):
            rows = [row for row, n in zip(ids, runs.jams.tolist(), strict=True) if n]
            yield f'{jams} of the {len(ids) * runs.parts} simulated parts jam: {rows_text(rows)}.'
        for t, of_trap in enumerate(found.outcomes):
            rows = [
                row for k, row in enumerate(ids) if runs.agrees(t, k, of_trap[k].outcome) is False
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
    def flags(self) -> list[dict[str, Any]]:
        """What limits the result, as flags with the ids of the rows."""
        found = self.passage
        ends = dict(zip(self.rows, found.ends, strict=True))
        rolls = [row for row in self.rows if row.rolls]
        unknown = [row for row, end in ends.items() if end in ('unknown', 'turn')]
        close = [
            row
            for k, row in enumerate(self.rows)
            if any(abs(of_trap[k].margin) < found.tolerance.both for of_trap in found.outcomes)
        ]
        rows = {
            'rolls': rolls,
            'unknown': [row for row in unknown if not row.rolls],
            'falls_off': [
                row
                for row, each in zip(self.rows, found.entry, strict=True)
                if each.outcome != 'pass'
            ],
            'jams': [row for row, end in ends.items() if end == 'jam'],
            'margin_below_tolerance': close,
            'alike': [row for row in self.rows if row.id in self.alike and len(self.alike) > 1],
        }
        return [
            {'flag': name, 'orientations': [row.id for row in each]}
            for name, each in rows.items()
            if each
        ]

    def _warnings(self) -> Iterator[str]:
        found = self.passage
        values = {
            'jams': share_text(found.jams),
            'tolerance': margin_text(found.tolerance.both),
        }
        shown = {self.rows[k].id for k in shown_rows(found)}
        for flag in self.flags:
            ids = [number for number in flag['orientations'] if number in shown]
            if ids:
                yield _FLAGS[flag['flag']].format(rows_text(ids), **values)
        lost = 1 - float(found.probability.sum())
        if self.before and lost > 5e-4:
            yield f'{share_text(lost)} % of the parts are in no aspect after the actions.'

    # -- Tables and documents ---------------------------------------------------------------------

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
        mirrored = mirror_images(self.rows, AT_WALL * self.part.hull_radius)
        return [
            {
                **row_fields(row),
                'lower': self.row_intervals[k].lower,
                'upper': self.row_intervals[k].upper,
                'alike': list(mirrored[k]),
                'on_track': self.passage.entry[k].outcome,
                'passes': [float(low[k]), float(high[k])],
            }
            for k, row in enumerate(self.rows)
        ]

    def _trap_fields(self) -> list[dict[str, Any]]:
        found = self.passage
        traps, outcomes = found.track.document['traps'], cast(Any, plain(found.outcomes))
        return [
            {
                **trap,
                'results': [
                    {
                        'id': row.id,
                        **outcomes[t][k],
                        'simulated': self._run_fields(t, k),
                    }
                    for k, row in enumerate(self.rows)
                ],
            }
            for t, trap in enumerate(traps)
        ]

    def _run_fields(self, t: int, k: int) -> dict[str, Any] | None:
        runs = self.runs
        share = None if runs is None else runs.share(t, k)
        if runs is None or share is None or not runs.simulated[t]:
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
        if self.design is None:
            return None
        return {
            'proposals': [
                {'margin': plain(each.margin), 'traps': each.passage.track.document['traps']}
                for each in self.design.designs
            ],
            'alike': list(self.design.alike),
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
            'advice': list(self.advice),
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

    # -- Pictures and page ------------------------------------------------------------------------

    def figure(self) -> 'Figure':
        """Return each orientation from above, with its contact, and whether it passes."""
        rows = [self.rows[k] for k in shown_rows(self.passage)]
        outlines = [self._outline(row) for row in rows]
        return rows_figure(self.passage, outlines, [self._supported(row) for row in rows])

    def page(self) -> 'Page':
        """Return a page with the rows, the track to scale, and where the parts go."""
        # This import takes about a second.
        from resting_aspects_ros.api.pages import part_facts, run_facts
        from resting_aspects_ros.report.page import Chart, Page, Section, Text, file_names, reading

        covered, run = self.drop.range_text, self.drop.run
        rows, *of_traps = self.tables()
        rows.title = ''
        rows.caption = f'{rows.caption} {covered}'.rstrip()
        chart = Chart(
            'orientations',
            'Each orientation from above at the wall, with its contact and its centre of mass',
            self.figure,
            'From above; the wall is the thick line, and parts move to the right. Blue: where the '
            'part touches the track. Dashed: the region that the narrowest part of the track '
            'supports, in which the centre of mass, the cross, has to be. The margin is that of '
            'the trap that stops the row, or the least one.',
            self.figure,
        )
        sections = [Section('Orientations on the track', 'orientations', [chart, rows])]
        if self.trap_names:
            sections.append(Section('Traps', 'traps', list(self._trap_items(of_traps))))
        return Page(
            file=PAGE,
            title=run.part,
            topic='track',
            lead='What passes the traps of the track',
            subtitle=self.title.split('\n')[0],
            sections=sections,
            reading=reading('track'),
            facts={
                'Part': part_facts(self.part, run, self.drop.distribution.aspects),
                'Track': list(self._track_facts()),
                'Run': run_facts(run, self.drop.distribution.drops, 'drops'),
            },
            top=[Text(each, 'verdict') for each in self.sentences if each != covered],
            names=file_names(PAGE, FIGURES),
        )

    def _trap_items(self, tables: list[Table]) -> 'Iterator[Item]':
        """Yield the track to scale, the tables of the traps and of the bands, and the flow."""
        from resting_aspects_ros.report.page import Chart, Fold

        found, names = self.passage, self.trap_names
        wanted = next(row for row in self.rows if row.id in found.wanted)
        cuts = [t.removed() if isinstance(t, Cut) else None for t in found.track.traps]
        draw = partial(track_figure, found.track.surface.width, names, cuts, self._outline(wanted))
        flow = partial(flow_figure, found, names)
        yield Chart(
            'track',
            'The track from above with its traps, to scale',
            draw,
            'To scale, from above, with the first wanted orientation before the traps.',
            draw,
        )
        of_traps, *of_bands = tables
        if len(of_traps.rows) > MANY_ROWS:
            yield Fold('what each trap does to each row', [of_traps])
        else:
            yield of_traps
        yield from of_bands
        yield Chart(
            'flow',
            'Share of the parts before and after each trap, by row',
            flow,
            'The height of a band is a share of the parts, and its number a row. Below are the '
            'parts that leave the track; grey is what statics does not tell.',
            flow,
        )

    def _track_facts(self) -> Iterator[tuple[str, str]]:
        """Yield label and value of each dimension of the track: mm and degrees."""
        track = self.passage.track
        for of in (track.surface, track.wall, track):
            for name, each in quantities_of(of).items():
                label = each.label if name not in ('friction', 'height') else each.text
                yield label, value_text(getattr(of, name), each.unit)

    def _outline(self, row: Orientation) -> shapely.Geometry:
        """Return the outline of a row from above, m, the wall at y = 0."""
        outline = seen_outline(self.part, row.orientation)
        return shapely.affinity.translate(outline, 0.0, row.yaw.distance)

    def _supported(self, row: Orientation) -> shapely.Geometry:
        """Return what still carries the row on the narrowest track that no trap interrupts, m."""
        area = self.passage.track.surface.area
        for trap in self.passage.track.traps:
            if isinstance(trap, Cut) and trap.span() is None:
                area = area.difference(trap.removed())
        return shapely.convex_hull(shapely.intersection(row.contact, area))


def _cell(value: Any) -> str:
    """Return a value of a CSV file: lists have spaces between their items."""
    if isinstance(value, list):
        return ' '.join(map(str, value))
    return '' if value is None else str(value)
