"""A forecast of parts per minute as a sentence, tables, document and figure."""

import dataclasses
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.feeding.footprint import MAX_COVERAGE
from resting_aspects_ros.feeding.forecast import Curve, FeederModel, Forecast
from resting_aspects_ros.feeding.steady_state import cycle_time
from resting_aspects_ros.report.document import plain
from resting_aspects_ros.report.figure import (
    FAINT,
    TEXT,
    Header,
    percent_axis,
    pixel_axes,
    plain_axes,
)
from resting_aspects_ros.report.format import (
    COLOURS,
    aspects_text,
    ids_text,
    minutes_text,
    number_text,
    share_text,
)
from resting_aspects_ros.report.table import NOTHING, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resting_aspects_ros.feeding.tray_simulation import ControlledRuns


# A rate below this many parts per minute is none.
NO_RATE = 1e-6
_HEADING_WIDTH = 22


@dataclass(frozen=True, eq=False)
class NamedForecast:
    """A forecast with the names of its part, its action and its aspects.

    rows : tuple of tuples of Aspect
        The aspects, or symmetry classes, that the model refers to.
    """

    part: str
    action: str
    rows: tuple[tuple[Aspect, ...], ...]
    model: FeederModel
    forecast: Forecast

    @property
    def pickable_text(self) -> str:
        """The pickable aspects: 'aspect 3', 'aspects 1 and 2'."""
        return _aspects_text(self.rows, self.model.pickable.tolist())

    @property
    def title(self) -> str:
        """Part and pickable aspects."""
        return f'{self.part}, {self.pickable_text}'


def forecast_sentence(named: NamedForecast) -> str:
    """Return '41 parts per minute (38 to 44) with 60 parts on the tray; the robot limits'."""
    found = named.forecast
    if found.rate < NO_RATE:
        return f'no part can be picked: {_reason(named)}'
    rate, lower, upper = _rate_texts(found.rate, found.lower, found.upper)
    parts = 'part' if found.number == 1 else 'parts'
    return (
        f'{rate} parts per minute ({lower} to {upper}) with {found.number} {parts} on the tray; '
        f'{"vision" if found.limited_by == "vision" else f"the {found.limited_by}"} limits'
    )


def cell_text(named: NamedForecast) -> str:
    """Return the times, the tray and the gripper that a forecast is for, in one sentence."""
    times, tray = named.model.times, named.model.tray
    facts = [
        f'robot {times.robot:g} s',
        f'feeder motion {times.vibrate:g} s',
        f'settling {times.settle:g} s',
        f'image {times.image:g} s',
    ]
    if times.supply:
        facts.append(f'supply per part {times.supply:g} s')
    if times.place:
        facts.append(f'overlap {times.overlap:g} s')
    facts.append('tray {:g} x {:g} mm'.format(*(1000 * side for side in tray.size)))
    facts.append(f'clearance {1000 * tray.clearance:g} mm')
    if tray.gripper is not None:
        facts.append(f'gripper {tray.gripper.text}')
    if named.model.max_picks is not None:
        facts.append(f'maximum picks per image {named.model.max_picks}')
    return f'For {", ".join(facts)}.'


def range_text(named: NamedForecast) -> str:
    """Return what the two ranges of a forecast contain, in one or two sentences."""
    found = named.forecast
    if not found.broken:
        return ''
    low, high = _rate_texts(*found.wide)
    return (
        'The first range contains the number of drops and actions alone. If all assumptions of '
        f'the table are broken together, the rate is {low}: {low} to {high} per minute are '
        'possible. Count a real tray to narrow this.'
    )


def forecast_notes(named: NamedForecast) -> list[str]:
    """Return a sentence on where the model ends, if the forecast is there."""
    found = named.forecast
    beyond = found.coverage > 1.02 * MAX_COVERAGE
    if not beyond and not (found.at_limit and found.number == found.best_number):
        return []
    text = (
        f'The parts cover {share_text(found.coverage)} % of the tray. Above about '
        f'{100 * MAX_COVERAGE:g} %, parts lean on each other or entangle, which the forecast does '
        'not include.'
    )
    return [text]


def forecast_table(forecasts: Sequence[NamedForecast]) -> Table:
    """Return a table with a column for each forecast."""
    headings = [textwrap.fill(each.title, _HEADING_WIDTH) for each in forecasts]
    best = all(each.forecast.number == each.forecast.best_number for each in forecasts)
    first = 'with the best number of parts' if best else ''
    table = Table('', (first, *headings), texts={first})
    columns = [dict(_cells(each)) for each in forecasts]
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    return table


def mix_table(named: NamedForecast) -> Table:
    """Return a table of the aspects: shares of a drop and on the tray, free and picked parts."""
    headings = ('drop\n(%)', 'on the\ntray (%)', 'free\n(%)', 'picked\n(%)', 'seen from above')
    table = Table('', ('aspect', 'pickable', *headings))
    model, found = named.model, named.forecast
    drop = model.drop / model.drop.sum()
    for k, row in enumerate(named.rows):
        shares = (drop[k], found.state.mix[k], found.free[k], found.state.taken[k])
        pickable = 'yes' if model.pickable[k] else 'no'
        texts = (share_text(float(share)) for share in shares)
        table.add_row(ids_text(row), pickable, *texts, model.footprints[k].text)
    return table


def _cells(named: NamedForecast) -> list[tuple[str, str]]:
    model, found = named.model, named.forecast
    picks = found.state.picks
    rate, lower, upper = _rate_texts(found.rate, found.lower, found.upper)
    low, high = (_rate_texts(end, found.lower, found.upper)[0] for end in found.prediction)
    cycle = float(cycle_time(model.times, picks, found.state.supplied))
    none = found.rate < NO_RATE
    shares = found.time_shares
    effects = [
        (f'10 % less time: {name}', f'{100 * found.sensitivity[name][0]:+.1f} %')
        for name in ('robot', 'vibrate', 'settle', 'image')
    ]
    wide = ' to '.join(_rate_texts(*found.wide))
    broken = [
        (each.text, f'{_rate_texts(each.rate)[0]} ({100 * each.change:+.1f} %)')
        for each in found.broken
    ]
    return [
        ('parts per minute', f'{rate}\n{lower} to {upper}'),
        ('with broken assumptions', wide),
        *broken,
        (f'in a run of {minutes_text(found.minutes)}', f'{low} to {high}'),
        ('parts on the tray', str(found.number)),
        ('best number', str(found.best_number or NOTHING)),
        ('covered share of the tray', f'{share_text(found.coverage)} %'),
        ('picks per cycle', number_text(float(picks.mean)) if picks.mean > 0 else '0'),
        ('duration of a cycle', f'{number_text(cycle)} s'),
        ('cycles without a pick', f'{share_text(float(picks.none))} %'),
        ('flips of a part until picked', NOTHING if none else number_text(found.flips_per_part)),
        ('time of the robot', f'{share_text(shares["robot"])} %'),
        ('limited by', found.limited_by or NOTHING),
        *([] if none else effects),
    ]


def _reason(named: NamedForecast) -> str:
    model, found = named.model, named.forecast
    if found.trapped.any():
        trapped = _aspects_text(named.rows, found.trapped.tolist())
        return (
            f'in the long run all parts are in {trapped}, from where no {named.action} brings a '
            f'part to {named.pickable_text}'
        )
    clearance = f'{1000 * model.tray.clearance:g} mm'
    return f'with {found.number} parts on the tray none is free with a clearance of {clearance}'


def _aspects_text(rows: Sequence[tuple[Aspect, ...]], mask: Sequence[bool]) -> str:
    found = tuple(
        aspect for row, wanted in zip(rows, mask, strict=True) if wanted for aspect in row
    )
    found = tuple(sorted(found, key=lambda aspect: aspect.id))
    return aspects_text(found)


def _rate_texts(*rates: float) -> list[str]:
    """Return rates with the decimals that the largest needs for two digits.

    They have at least one if all rates are within one part per minute.
    """
    largest = max(rates)
    decimals = 0 if largest >= 9.95 else 1 if largest >= 0.995 else 3
    if largest - min(rates) < 1:
        decimals = max(decimals, 1)
    return [f'{rate:.{decimals}f}' for rate in rates]


def controlled_text(found: 'ControlledRuns') -> str:
    """Return 'with feeder_controller: 33.5 parts per minute (29.8 to 36.2 in 5 minutes)'."""
    low, high = map(number_text, found.prediction)
    return (
        f'with feeder_controller: {number_text(found.rate)} parts per minute '
        f'({low} to {high} in {minutes_text(found.minutes)})'
    )


def controlled_fields(found: 'ControlledRuns') -> dict[str, Any]:
    """Return the fields of a document; rates are parts per minute."""
    low, high = found.prediction
    return {
        'parts_per_minute': found.rate,
        'lower': found.lower,
        'upper': found.upper,
        'prediction_minutes': found.minutes,
        'prediction_lower': low,
        'prediction_upper': high,
    }


_SIZES = ('length', 'width', 'radius')


def forecast_fields(named: NamedForecast) -> dict[str, Any]:
    """Return a forecast as plain JSON types; docs/reference/files.md describes the keys."""
    model, found = named.model, named.forecast
    gripper = model.tray.gripper
    state = found.state
    lower, upper = found.prediction
    drop = model.drop / model.drop.sum()
    rows = zip(named.rows, model.footprints, drop.tolist(), strict=True)
    document = {
        'sentence': forecast_sentence(named),
        'parts_per_minute': found.rate,
        'lower': found.lower,
        'upper': found.upper,
        'model_lower': found.wide[0],
        'model_upper': found.wide[1],
        'assumptions': [
            {'text': each.text, 'parts_per_minute': each.rate, 'change': each.change}
            for each in found.broken
        ],
        'prediction_lower': lower,
        'prediction_upper': upper,
        'minutes': found.minutes,
        'parts_on_tray': found.number,
        'best_number': found.best_number,
        'best_number_is_limit': found.at_limit,
        'flips_per_part': found.flips_per_part,
        'empty_cycles': state.picks.none,
        'picks_per_cycle': state.picks.mean,
        'supplied_per_cycle': state.supplied,
        'cycle_time': cycle_time(model.times, state.picks, state.supplied),
        'coverage': found.coverage,
        'limited_by': found.limited_by,
        'max_picks': model.max_picks,
        'times': {**dataclasses.asdict(model.times), 'overlap': model.times.overlap},
        'tray': {
            'width': model.tray.size[0],
            'depth': model.tray.size[1],
            'clearance': model.tray.clearance,
            'gripper': gripper and {name: getattr(gripper, name) for name in _SIZES},
        },
        'time_shares': found.time_shares,
        'sensitivity': {
            name: {'shorter': 100 * shorter, 'longer': 100 * longer}
            for name, (shorter, longer) in found.sensitivity.items()
        },
        'curve': _points(found.curve),
        'mix': [
            {
                'aspects': [aspect.id for aspect in row],
                'symmetry_class': row[0].symmetry_class,
                'pickable': model.pickable[k],
                'drop': share,
                'on_tray': state.mix[k],
                'free': found.free[k],
                'picked': state.taken[k],
                'length': footprint.length + 2 * footprint.radius,
                'width': footprint.width + 2 * footprint.radius,
            }
            for k, (row, footprint, share) in enumerate(rows)
        ],
    }
    return {name: plain(value) for name, value in document.items()}


def _points(curve: Curve) -> list[dict[str, Any]]:
    columns = {
        'number': curve.number,
        'parts_per_minute': curve.rate,
        'lower': curve.lower,
        'upper': curve.upper,
        'empty_cycles': curve.empty_cycles,
        'free': curve.free,
    }
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


# What explains the figure.
FORECAST_NOTE = (
    'Parts per minute in the long run; the band is the interval that follows from the number '
    'of simulated drops and actions. Dot: best number of parts on the tray. Below: the share '
    'of the cycles without a pick.'
)
# Sizes in pixels.
WIDTH, LEFT, RIGHT = 1240, 92, 40
RATE, EMPTY, GAP, BOTTOM, NAME = 400, 150, 92, 70, 24
_LINES = (COLOURS[0], COLOURS[3], COLOURS[5], COLOURS[7], COLOURS[9])


def forecast_figure(forecasts: Sequence[NamedForecast], title: str) -> 'Figure':
    """Draw two charts, with a line for each forecast.

    Parts per minute against the number of parts on the tray, with the interval of the long run as
    a band and a dot at the best number; and the share of cycles without a pick. Without a title,
    the figure has no explanation either; see FORECAST_NOTE.
    """
    header = Header(title, FORECAST_NOTE if title else '', WIDTH)
    names = NAME * (len(forecasts) + 1 if len(forecasts) > 1 else 1)
    height = header.height + names + RATE + GAP + EMPTY + BOTTOM
    figure, canvas = pixel_axes(WIDTH, height)
    header.draw(canvas)

    def axes_at(bottom: float, size: float) -> 'Axes':
        place = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, size / height)
        return figure.add_axes(place)

    _draw_rates(axes_at(BOTTOM + EMPTY + GAP, RATE), forecasts)
    _draw_empty(axes_at(BOTTOM, EMPTY), forecasts)
    for k, each in enumerate(forecasts if len(forecasts) > 1 else ()):
        y = height - header.height - NAME * (k + 0.1)
        canvas.plot([LEFT, LEFT + 40], [y, y], color=_colour(k), linewidth=2)
        canvas.text(LEFT + 50, y, each.title, size=8.5, color=TEXT, va='center')
    return figure


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


def _name(axes: 'Axes', text: str) -> None:
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
