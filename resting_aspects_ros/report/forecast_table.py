"""A forecast of parts per minute as a sentence and as a table."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.feeding.footprint import MAX_COVERAGE
from resting_aspects_ros.feeding.forecast import FeederModel, Forecast
from resting_aspects_ros.feeding.steady_state import cycle_time
from resting_aspects_ros.report.rounding import minutes_text, number_text, share_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING
from resting_aspects_ros.report.transition_table import titled_table

# A rate below this many parts per minute is none.
NO_RATE = 1e-6
# A smaller share of cycles without a pick is not stated exactly.
MIN_SHARE = 1e-4
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
    """Return the times, the tray and the clearance that a forecast is for, in one sentence."""
    times, tray = named.model.times, named.model.tray
    names = {
        'robot': times.robot,
        'feeder motion': times.vibrate,
        'settling': times.settle,
        'image': times.image,
    }
    facts = [f'{name} {seconds:g} s' for name, seconds in names.items()]
    if times.supply:
        facts.append(f'supply {times.supply:g} s per part')
    if times.place:
        facts.append(f'overlap {times.overlap:g} s')
    facts.append('tray {:g} x {:g} mm'.format(*(1000 * side for side in tray.size)))
    facts.append(f'clearance {1000 * tray.clearance:g} mm')
    if tray.gripper is not None:
        facts.append(f'gripper {tray.gripper.text}')
    if named.model.max_picks is not None:
        facts.append(f'at most {named.model.max_picks} picks per image')
    return f'For {", ".join(facts)}.'


def forecast_notes(named: NamedForecast) -> list[str]:
    """Return sentences on where the model ends, if the forecast is there."""
    found, notes = named.forecast, []
    percent = f'{100 * MAX_COVERAGE:g} %'
    if found.coverage > 1.02 * MAX_COVERAGE:
        notes.append(
            f'The parts cover {share_text(found.coverage)} % of the tray. Above about {percent}, '
            'parts lean on each other or entangle, which the forecast does not include.'
        )
    elif found.at_limit and found.number == found.best_number:
        notes.append(
            'More parts on the tray might give a higher rate, but above a coverage of about '
            f'{percent}, parts lean on each other or entangle, which the forecast does not '
            'include.'
        )
    if found.best_number == 1:
        notes.append('With more than one part on the tray, too few parts are free.')
    return notes


def forecast_table(forecasts: Sequence[NamedForecast]) -> Table:
    """Return a table with a column for each forecast."""
    headings = [textwrap.fill(each.title, _HEADING_WIDTH) for each in forecasts]
    table = titled_table('', 'with the best number of parts', *headings)
    if any(each.forecast.number != each.forecast.best_number for each in forecasts):
        table.columns[0].header = ''
    table.columns[0].justify = 'left'
    columns = [dict(_cells(each)) for each in forecasts]
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    return table


def mix_table(named: NamedForecast) -> Table:
    """Return a table of the aspects: shares of a drop and on the tray, free and picked parts."""
    headings = ('drop\n(%)', 'on the\ntray (%)', 'free\n(%)', 'picked\n(%)', 'seen from above')
    table = titled_table('', 'aspect', 'pickable', *headings)
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
    return [
        ('parts per minute', f'{rate}\n{lower} to {upper}'),
        (f'in a run of {minutes_text(found.minutes)}', f'{low} to {high}'),
        ('parts on the tray', str(found.number)),
        ('best number', str(found.best_number or NOTHING)),
        ('covered share of the tray', f'{share_text(found.coverage)} %'),
        ('picks per cycle', number_text(float(picks.mean)) if picks.mean > 0 else '0'),
        ('duration of a cycle', f'{number_text(cycle)} s'),
        ('cycles without a pick', _small_share_text(float(picks.none))),
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
    return f'aspect{"s" * (len(found) > 1)} {ids_text(found)}'


def _small_share_text(share: float) -> str:
    return f'{share_text(share)} %' if share == 0 or share >= MIN_SHARE else '< 0.01 %'


def _rate_texts(*rates: float) -> list[str]:
    """Return rates with the decimals that the largest needs for two digits.

    They have at least one if all rates are within one part per minute.
    """
    largest = max(rates)
    decimals = 0 if largest >= 9.95 else 1 if largest >= 0.995 else 3
    if largest - min(rates) < 1:
        decimals = max(decimals, 1)
    return [f'{rate:.{decimals}f}' for rate in rates]
