"""The shares of the classes in each window of a drift test, against the simulation."""

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.core.statistics.intervals import bounds
from resting_aspects_ros.report.colours import COLOURS
from resting_aspects_ros.report.drift_text import DriftWindows, drift_sentence
from resting_aspects_ros.report.figure_style import (
    FAINT,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.figure import Figure

WIDTH, ROW, TOP, BOTTOM = 8.6, 1.25, 0.9, 0.6  # inches
LEFT, RIGHT = 1.1, 0.25
MAX_CLASSES = 8
TITLE_WIDTH = 105  # characters
ALARM: dict[str, Any] = {'color': '#D55E00', 'alpha': 0.14, 'linewidth': 0}
BAND = 0.22


def drift_figure(tested: DriftWindows) -> 'Figure':
    """Plot the share of each class in the windows, with its interval and the simulated share.

    The dashed lines are the simulated shares; the bands are Wilson intervals of the share of a
    window. Windows with an alarm are shaded. Of more than MAX_CLASSES classes, those with the
    largest simulated shares are shown.
    """
    test = tested.test
    order = np.argsort(-test.simulated, kind='stable')[:MAX_CLASSES]
    height = TOP + BOTTOM + ROW * len(order)
    figure = new_figure(WIDTH, height)
    title = '\n'.join(textwrap.wrap(drift_sentence(tested), TITLE_WIDTH)[:3])
    figure.text(0.1 / WIDTH, 1 - 0.12 / height, title, size=9, weight='bold', color=TEXT, va='top')
    _draw_legend(figure, tested, height)
    sizes = np.diff(tested.ends)
    lower, upper = bounds(test.windows, sizes, confidence=tested.confidence)
    share = test.windows / sizes[:, None]
    for row, k in enumerate(sorted(order.tolist())):
        bottom = BOTTOM + ROW * (len(order) - 1 - row)
        place = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, 0.8 * ROW / height)
        axes = figure.add_axes(place)
        plain_axes(axes, 'y')
        axes.set_xlim(0, tested.ends[-1])
        top = min(1.15 * max(float(upper[:, k].max()), 0.01), 1.0)
        axes.set_ylim(0, top)
        percent_axis(axes, 'y', top)
        for alarm in test.alarms:
            axes.axvspan(*tested.ends[alarm : alarm + 2], **ALARM)
        colour = COLOURS[(tested.live.ids[k] - 1) % len(COLOURS)]
        axes.stairs(
            upper[:, k], tested.ends, baseline=lower[:, k], fill=True, color=colour, alpha=BAND
        )
        axes.stairs(share[:, k], tested.ends, baseline=None, color=colour, linewidth=1.6)
        axes.axhline(
            test.simulated[k] / test.simulated.sum(), color=TEXT, linewidth=0.9, linestyle='--'
        )
        axes.set_ylabel(f'class {tested.names[k]}', size=8, color=TEXT)
        last = row == len(order) - 1
        axes.tick_params(axis='x', labelbottom=last)
        if last:
            axes.set_xlabel('number of counted parts', size=8, color=FAINT)
    return figure


def _draw_legend(figure: 'Figure', tested: DriftWindows, height: float) -> None:
    """Draw the meaning of lines and areas between the title and the first class."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = {
        'share in a window': Line2D([], [], color=FAINT, linewidth=1.6),
        f'its {100 * tested.confidence:.10g} % interval': Patch(
            color=FAINT, alpha=BAND, linewidth=0
        ),
        'share in the simulation': Line2D([], [], color=TEXT, linewidth=0.9, linestyle='--'),
        'window with an alarm': Patch(**ALARM),
    }
    figure.legend(
        list(handles.values()), list(handles), loc='upper left', ncols=len(handles), fontsize=8,
        labelcolor=FAINT, frameon=False, borderaxespad=0,
        bbox_to_anchor=(LEFT / WIDTH, 1 - 0.6 / height),
    )  # fmt: skip
