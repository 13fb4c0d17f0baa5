"""Parts per minute and empty cycles against the number of parts, and where the time goes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from resting_aspects_ros.report.colours import COLOURS, GREY
from resting_aspects_ros.report.figure_style import FAINT, PAPER, TEXT, percent_axis, plain_axes
from resting_aspects_ros.report.forecast_table import NamedForecast
from resting_aspects_ros.report.pixel_axes import Header, pixel_axes

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Sizes in pixels.
WIDTH, LEFT, RIGHT = 1240, 92, 40
RATE, EMPTY, GAP, BAR, BOTTOM, NAME = 400, 150, 92, 44, 70, 24
# Colours of the times of a cycle, and the labels of those times.
_TIMES = {
    'vibrate': (COLOURS[1], 'vibrate'),
    'settle': (COLOURS[6], 'settle'),
    'image': (COLOURS[4], 'image'),
    'supply': (GREY, 'supply'),
    'robot': (COLOURS[2], 'robot'),
}
_LINES = (COLOURS[0], COLOURS[3], COLOURS[5], COLOURS[7], COLOURS[9])
# A share of the time below this has no label in its bar.
_LABELLED = 0.09


def forecast_figure(forecasts: Sequence[NamedForecast], title: str) -> 'Figure':
    """Draw three charts, with a line and a bar for each forecast.

    Parts per minute against the number of parts on the tray, with the interval of the long run as
    a band, a dot at the best number, and a circle at the number of the forecast if that is another
    one; the share of cycles without a pick; and the shares of the time of a cycle.

    Parameters
    ----------
    forecasts : sequence of NamedForecast
        At least one.
    title : str
        Without a title, the figure has no explanation either; see forecast_note.
    """
    header = Header(title, forecast_note(forecasts) if title else '', WIDTH)
    bars = len(forecasts) * (BAR + NAME)
    names = NAME * (len(forecasts) + 1 if len(forecasts) > 1 else 1)
    height = header.height + names + RATE + GAP + EMPTY + GAP + bars + BOTTOM
    figure, canvas = pixel_axes(WIDTH, height)
    header.draw(canvas)

    def axes_at(bottom: float, size: float) -> 'Axes':
        place = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, size / height)
        return figure.add_axes(place)

    shares, empty = axes_at(BOTTOM, bars), axes_at(BOTTOM + bars + GAP, EMPTY)
    rate = axes_at(BOTTOM + bars + GAP + EMPTY + GAP, RATE)
    _draw_rates(rate, forecasts)
    _draw_empty(empty, forecasts)
    _draw_times(shares, forecasts)
    for k, each in enumerate(forecasts if len(forecasts) > 1 else ()):
        y = height - header.height - NAME * (k + 0.1)
        canvas.plot([LEFT, LEFT + 40], [y, y], color=_colour(k), linewidth=2)
        canvas.text(LEFT + 50, y, each.title, size=8.5, color=TEXT, va='center')
    return figure


def forecast_note(forecasts: Sequence[NamedForecast]) -> str:
    """Return the text that explains the figure."""
    return (
        'Parts per minute in the long run; the band is the interval that follows from the number '
        'of simulated drops and actions. Dot: best number of parts on the tray'
        + (
            '; circle: number of the forecast. '
            if any(each.forecast.number != each.forecast.best_number for each in forecasts)
            else '. '
        )
        + 'Below: the share of the cycles without a pick, and the shares of the time of a cycle '
        '(from the left vibrate, settle, image, supply and robot)'
        + (
            ', where the time in which feeder and robot overlap is that of the feeder.'
            if any(each.model.times.overlap for each in forecasts)
            else '.'
        )
    )


def _draw_rates(axes: 'Axes', forecasts: Sequence[NamedForecast]) -> None:
    for k, each in enumerate(forecasts):
        curve, found = each.forecast.curve, each.forecast
        axes.fill_between(
            curve.number, curve.lower, curve.upper, color=_colour(k), alpha=0.22, linewidth=0
        )
        axes.plot(curve.number, curve.rate, color=_colour(k), linewidth=1.8)
        rates = dict(zip(curve.number.tolist(), curve.rate.tolist(), strict=True))
        if found.best_number is not None:
            best = rates[found.best_number]
            axes.plot(found.best_number, best, 'o', color=_colour(k), markersize=7)
            axes.annotate(
                f'{found.best_number}',
                (found.best_number, best),
                (0, 7),
                textcoords='offset points',
                ha='center',
                size=8.5,
                weight='bold',
                color=TEXT,
            )
        if found.number != found.best_number:
            here = rates[found.number]
            axes.plot(
                found.number, here, 'o', color=_colour(k), markerfacecolor=PAPER, markersize=7
            )
    _number_axis(axes, forecasts)
    top = max(float(each.forecast.curve.upper.max()) for each in forecasts)
    axes.set_ylim(0, 1.12 * top or 1.0)
    _name(axes, 'parts per minute')


def _draw_empty(axes: 'Axes', forecasts: Sequence[NamedForecast]) -> None:
    for k, each in enumerate(forecasts):
        curve = each.forecast.curve
        axes.plot(curve.number, curve.empty_cycles, color=_colour(k), linewidth=1.8)
    _number_axis(axes, forecasts)
    axes.set_ylim(0, 1)
    percent_axis(axes, 'y', 1.0)
    _name(axes, 'cycles without a pick')
    axes.set_xlabel('parts on the tray', size=8, color=FAINT, labelpad=8)


def _draw_times(axes: 'Axes', forecasts: Sequence[NamedForecast]) -> None:
    plain_axes(axes, 'x')
    for k, each in enumerate(forecasts):
        left, y = 0.0, -float(k)
        for name, share in each.forecast.time_shares.items():
            colour, label = _TIMES[name]
            axes.barh(y, share, BAR / (BAR + NAME), left=left, color=colour, edgecolor=PAPER)
            if share >= _LABELLED:
                text = f'{label} {100 * share:.0f} %'
                # Black is legible on all colours of the times.
                axes.text(left + share / 2, y, text, ha='center', va='center', size=8)
            left += share
        if len(forecasts) > 1:
            axes.text(0, y + 0.36, each.title, va='bottom', size=7.5, color=FAINT)
    axes.set_ylim(-len(forecasts) + 0.5, 0.5 + 0.1 * (len(forecasts) > 1))
    axes.set_yticks([])
    axes.set_xlim(0, 1)
    percent_axis(axes, 'x', 1.0)
    axes.set_xlabel('share of the time of a cycle', size=8, color=FAINT, labelpad=8)


def _name(axes: 'Axes', text: str) -> None:
    """Write what a chart shows above its left end."""
    axes.annotate(
        text,
        (0, 1),
        (0, 8),
        xycoords='axes fraction',
        textcoords='offset points',
        size=8,
        color=FAINT,
    )


def _number_axis(axes: 'Axes', forecasts: Sequence[NamedForecast]) -> None:
    from matplotlib.ticker import MaxNLocator

    plain_axes(axes, 'y')
    last = max(int(each.forecast.curve.number[-1]) for each in forecasts)
    axes.set_xlim(0, 1.02 * last)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _colour(k: int) -> str:
    return _LINES[k % len(_LINES)]
