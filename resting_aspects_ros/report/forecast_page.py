"""Write a forecast of parts per minute as one self-contained HTML page, and as a figure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from resting_aspects_ros.report.figure import inline_svg, svg_text
from resting_aspects_ros.report.forecast import (
    NamedForecast,
    forecast_figure,
    forecast_note,
    forecast_notes,
    forecast_sentence,
    forecast_table,
    mix_table,
)
from resting_aspects_ros.report.page_table import PageTable, page_table
from resting_aspects_ros.report.page_template import ENDINGS, figure_files, render_page

PAGE, FIGURE = 'forecast.html', 'forecast'
FILES = [PAGE, *(f'{FIGURE}.{ending}' for ending in ENDINGS)]
_LABEL = 'Line charts of parts per minute and of cycles without a pick against the number of parts'
_CSS_PIXELS_PER_INCH = 96


@dataclass(frozen=True, eq=False)
class ForecastReport:
    """The content of a page.

    title, subtitle : str
        The parts, and the action and the surface in a few words.
    forecasts : sequence of NamedForecast
        At least one.
    notes, facts
        As in page.Report.
    """

    title: str
    subtitle: str
    forecasts: Sequence[NamedForecast]
    confidence: float
    notes: Sequence[str] = ()
    facts: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)


def forecast_files(report: ForecastReport) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of each file: the figure, then the page."""
    title = f'{report.title}, {report.subtitle}'
    yield from figure_files(FIGURE, forecast_figure(report.forecasts, title))
    figure = forecast_figure(report.forecasts, '')
    several = len(report.forecasts) > 1
    page = render_page(
        'forecast.html',
        report=report,
        sentences=[
            f'{each.title}: {forecast_sentence(each)}' if several else forecast_sentence(each)
            for each in report.forecasts
        ],
        limits=list(
            dict.fromkeys(note for each in report.forecasts for note in forecast_notes(each))
        ),
        chart={
            'svg': inline_svg(svg_text(figure), FIGURE, _LABEL),
            'width': round(_CSS_PIXELS_PER_INCH * figure.get_figwidth()),
            'label': _LABEL,
            'caption': forecast_note(report.forecasts),
        },
        numbers=page_table(forecast_table(report.forecasts)),
        mixes=[(each.title, page_table(mix_table(each))) for each in report.forecasts],
        curves=[(each.title, _curve(each)) for each in report.forecasts],
        minutes=f'{report.forecasts[0].forecast.minutes:g}',
        confidence=f'{100 * report.confidence:g}',
    )
    yield PAGE, page.encode()


def _curve(named: NamedForecast) -> PageTable:
    curve = named.forecast.curve
    headings = ('parts on the tray', 'parts per minute', 'interval', 'empty cycles', 'free')
    rows = zip(
        curve.number.tolist(),
        curve.rate.tolist(),
        curve.lower.tolist(),
        curve.upper.tolist(),
        curve.empty_cycles.tolist(),
        curve.free.tolist(),
        strict=True,
    )
    cells = [
        [
            [f'{number}'],
            [f'{rate:.2f}'],
            [f'{lower:.2f} to {upper:.2f}'],
            [f'{100 * empty:.1f} %'],
            [f'{100 * free:.1f} %'],
        ]
        for number, rate, lower, upper, empty, free in rows
    ]
    return PageTable(headings, cells)
