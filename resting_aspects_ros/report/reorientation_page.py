"""Write transitions and retention curves as one self-contained HTML page, and as figures."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.report.format import ids_text
from resting_aspects_ros.report.page_table import PageTable, page_table, text_table
from resting_aspects_ros.report.page_template import chart, figure_files, render_page
from resting_aspects_ros.report.reorientation_report import (
    HEAT_MAP,
    MEASURED,
    PAGE,
    RETENTION,
    RETENTION_PAGE,
    ActionReport,
    ReorientationReport,
    Shares,
    suffix_of,
)
from resting_aspects_ros.report.transition_figures import (
    retention_figure,
    retention_note,
    transition_figure,
    transition_note,
)
from resting_aspects_ros.report.transitions import (
    Rows,
    interval_table,
    long_run_table,
    long_run_text,
    plan_table,
    retention_counts_table,
    retention_table,
    table_rows,
    wanted_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def reorientation_files(report: ReorientationReport) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of each file: the figures, then the page."""
    actions = []
    notes = list(report.notes)
    for number, action in enumerate(report.actions, start=1):
        shown = dict(_figures(report, action))
        suffix = suffix_of(action.name, [each.name for each in report.actions])
        inline = {name: figure.inline(f'{name}-{number}', notes) for name, figure in shown.items()}
        for name, figure in shown.items():
            if inline[name]:
                yield from figure_files(name + suffix, figure.draw(action.title))
        actions.append(_action_texts(report, action) | {'figures': inline})
    retention = None
    if report.curves:
        curves = _Figure(
            partial(retention_figure, report.curves, report.aspects, report.part),
            'Line chart of the probability to leave each aspect against the lift height',
            retention_note(report.curves, report.aspects),
        )
        inline = curves.inline(RETENTION, notes)
        if inline:
            yield from figure_files(RETENTION, curves.draw(f'{report.title}, {report.subtitle}'))
        retention = {
            'figure': inline,
            'levels': page_table(retention_table(report.curves, '', report.gravity)),
            'counts': page_table(retention_counts_table(report.curves, '')),
        }
    page = render_page(
        'reorientation.html',
        report=replace(report, notes=notes),
        actions=actions,
        wanted=_wanted_text(report),
        plan=_plan(report),
        retention=retention,
        confidence=f'{100 * report.confidence:g}',
    )
    yield PAGE if report.actions else RETENTION_PAGE, page.encode()


@dataclass(frozen=True, eq=False)
class _Figure:
    """A figure that is drawn with its title for a file, and without for the page.

    label : str
        Alternative text for screen readers.
    note : str
        The explanation, which the page shows below the figure.
    """

    draw: Callable[[str], 'Figure']
    label: str
    note: str

    def inline(self, name: str, notes: list[str]) -> dict[str, Any]:
        """Return what the macro ``figure`` shows; the name is unique in the page."""
        return chart(partial(self.draw, ''), name, self.label, self.note, notes)


def _figures(report: ReorientationReport, action: ActionReport) -> Iterator[tuple[str, _Figure]]:
    """Yield name and figure for those for which there are data."""
    heat_map = partial(transition_figure, action.matrix, report.part)
    label = f'Heat map of the transition probabilities of {action.name}'
    yield HEAT_MAP, _Figure(heat_map, label, transition_note(action.matrix))


def _action_texts(report: ReorientationReport, action: ActionReport) -> dict[str, Any]:
    by_class, by_aspect = (table_rows(report.aspects, by_class=each) for each in (True, False))
    several = len(by_class) < len(by_aspect)
    shares: list[PageTable] = []
    if action.shares is not None:
        of_class, of_aspect = action.shares
        shares = [_shares_table(report, by_class, of_class)]
        shares += [_shares_table(report, by_aspect, of_aspect)] if several else []
    way = None
    if action.way is not None:
        found = action.way
        table = wanted_table(by_aspect, found.wanted, found.probability, found.actions, '')
        way = page_table(table)
    return {
        'report': action,
        'matrix': [
            page_table(interval_table(action.matrix, by_class=each))
            for each in ((True, False) if several else (True,))
        ],
        'shares': shares,
        'way': way,
        'measured': text_table(MEASURED, action.measured) if action.measured else None,
    }


def _shares_table(report: ReorientationReport, rows: Rows, shares: Shares) -> PageTable:
    found = shares.long_run
    table = page_table(
        long_run_table(rows, found, shares.lower, shares.upper, shares.drop, '', report.confidence)
    )
    return replace(table, caption=long_run_text(rows, found))


def _plan(report: ReorientationReport) -> PageTable | None:
    if report.plan is None:
        return None
    rows = table_rows(report.aspects, by_class=False)
    return page_table(plan_table(rows, *report.plan, ''))


def _wanted_text(report: ReorientationReport) -> str:
    wanted = tuple(report.aspects.aspects[k - 1] for k in report.wanted)
    return f'aspect{"s" * (len(wanted) > 1)} {ids_text(wanted)}' if wanted else ''
