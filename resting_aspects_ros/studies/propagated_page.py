"""The page of a distribution on a surface that is not known exactly."""

from functools import partial
from typing import TYPE_CHECKING

from resting_aspects_ros.api.condition_text import condition_facts
from resting_aspects_ros.report.figure_style import (
    FAINT,
    TEXT,
    percent_axis,
)
from resting_aspects_ros.report.page_table import PageTable, text_table
from resting_aspects_ros.report.page_template import chart, render_page
from resting_aspects_ros.report.row_axes import WIDE, RowAxes
from resting_aspects_ros.report.rows import Row
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.studies.pages import case_colours, case_pictures
from resting_aspects_ros.studies.propagated_counts import PropagatedCounts, interval_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LABEL = 'Bars of the probability of each aspect class with two intervals'
LEGEND = (
    'bar: mean probability; black: sampling interval; grey, wide: interval with the unknown '
    'surface; dots: samples of the surface'
)


def propagated_page(result: PropagatedCounts) -> str:
    """Return the page as HTML."""
    found, names = result.by_class, result.case.class_names
    colours, pictures = case_colours(result.case), case_pictures(result.case)
    other = sum(result.other_ends().values())
    notes = [] if result.complete else ['The run was interrupted: some samples are missing.']
    if other:
        ends = ', '.join(f'{n} {name}' for name, n in result.other_ends().items() if n)
        notes.append(f'{other} of {result.drops} drops ended in no aspect: {ends}.')
    shown = chart(partial(propagated_figure, result), 'shares', _LABEL, LEGEND, notes)
    return render_page(
        'propagated.html',
        report={
            'title': result.part.name,
            'subtitle': f'{result.drops} drops, {result.drops_per_sample} at each of '
            f'{len(result.counts)} samples of the surface, seed {result.seed}',
            'notes': notes,
            'facts': {'Conditions': _facts(result)},
        },
        sentence=result.sentence(),
        classes=[
            {'name': name, 'colour': colour, 'picture': picture, 'share': f'{100 * p:.1f} %'}
            for name, colour, picture, p in zip(
                names, colours, pictures, found.means.tolist(), strict=False
            )
        ],
        chart=shown,
        numbers=_table(result),
        confidence=f'{100 * result.confidence:g}',
    )


def propagated_figure(result: PropagatedCounts) -> 'Figure':
    """Return bars of the probabilities, with both intervals and the shares of the samples."""
    found = result.by_class
    shares = found.counts / found.drops
    rows = [
        Row(name, int(count), interval, colour, tuple(members))
        for name, count, interval, colour, members in zip(
            result.case.class_names,
            found.counts.sum(axis=0),
            found.sampling(),
            case_colours(result.case),
            result.aspects.classes(),
            strict=False,
        )
    ]
    bands = RowAxes(rows, 0.5, WIDE, 0.4)
    axes = bands.axes
    bars = zip(rows, found.total(), bands.places.tolist(), shares.T, strict=True)
    top = 0.0
    for row, total, y, own in bars:
        sampling = row.interval
        axes.barh(y, sampling.probability, bands.data(0.3), color=row.colour, alpha=0.55)
        axes.plot(own, [y - bands.data(0.17)] * len(own), '.', color=row.colour, alpha=0.5, ms=3)
        axes.plot([total.lower, total.upper], [y, y], color=FAINT, linewidth=5, alpha=0.6)
        axes.plot([sampling.lower, sampling.upper], [y, y], color=TEXT, linewidth=1.6)
        top = max(top, total.upper, float(own.max()))
    axes.set_xlim(0, min(1.0, 1.05 * top))
    percent_axis(axes, 'x', min(1.0, 1.05 * top))
    return bands.figure


def _table(result: PropagatedCounts) -> PageTable:
    found = result.by_class
    headings = [
        'aspects',
        'probability',
        'by sampling alone',
        'with the surface',
        'part of the surface in the variance',
    ]
    rows = [
        [name, f'{100 * one.probability:.2f} %', interval_text(one), interval_text(both), part]
        for name, one, both, part in zip(
            result.case.class_names,
            found.sampling(),
            found.total(),
            [f'{100 * part:.0f} %' for part in found.part_of_surface.tolist()],
            strict=True,
        )
    ]
    return text_table(headings, rows)


def _facts(result: PropagatedCounts) -> list[tuple[str, str]]:
    """Return the surface, the range of each condition that was sampled, and the known ones."""
    ranges, unit = {}, {each.label: each.unit for each in QUANTITIES.values()}
    for name in result.samples[0]:
        values, label = [sample[name] for sample in result.samples], QUANTITIES[name].label
        ranges[label] = f'samples from {min(values):.3g} to {max(values):.3g} {unit[label]}'
    return [
        ('surface', result.conditions.surface or 'changed conditions of the calibrated surface'),
        *((label, ranges.get(label, text)) for label, text in condition_facts(result.conditions)),
    ]
