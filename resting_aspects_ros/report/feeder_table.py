"""The state of a running feeder beside its forecast, as a table and as a sentence."""

from dataclasses import dataclass
from typing import Protocol

from rich.table import Table

from resting_aspects_ros.report.rounding import minutes_text, number_text


class _Advice(Protocol):
    reason: str


class _Watch(Protocol):
    """What was counted; see client/feeder_watch.py."""

    images: int
    supplied: int
    on_tray: int
    advice: _Advice | None

    @property
    def picks(self) -> int: ...

    @property
    def missed(self) -> int: ...

    @property
    def choices(self) -> dict[str, int]: ...

    @property
    def minutes(self) -> float: ...

    @property
    def rate(self) -> float: ...


class _Forecast(Protocol):
    @property
    def rate(self) -> float: ...

    @property
    def prediction(self) -> tuple[float, float]: ...


@dataclass(frozen=True)
class FeederView:
    """What is shown of a feeder; rates are parts per minute, and times simulated minutes.

    lower, upper : float
        Prediction interval of the rate of a run of ``total`` minutes.
    """

    minutes: float
    total: float
    on_tray: int
    picks: int
    missed: int
    images: int
    flips: int
    supplied: int
    reason: str
    rate: float
    forecast: float
    lower: float
    upper: float

    @classmethod
    def of(cls, watch: _Watch, forecast: _Forecast, total: float) -> 'FeederView':
        """Return the view of what was counted beside a forecast."""
        lower, upper = forecast.prediction
        return cls(
            minutes=watch.minutes,
            total=total,
            on_tray=watch.on_tray,
            picks=watch.picks,
            missed=watch.missed,
            images=watch.images,
            flips=watch.choices['flip'],
            supplied=watch.supplied,
            reason=watch.advice.reason if watch.advice is not None else '',
            rate=watch.rate,
            forecast=forecast.rate,
            lower=lower,
            upper=upper,
        )

    @property
    def time(self) -> str:
        """Simulated time as minutes and seconds."""
        return '{}:{:02d}'.format(*divmod(round(60 * self.minutes), 60))

    @property
    def forecast_text(self) -> str:
        """The forecast with its interval."""
        return (
            f'{number_text(self.forecast)} '
            f'({number_text(self.lower)} to {number_text(self.upper)})'
        )


def feeder_table(view: FeederView) -> Table:
    """Return the table of a running feeder."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style='dim', no_wrap=True)
    table.add_column()
    rows = {
        'simulated time': f'{view.time} of {view.total:g} min',
        'parts in the image': str(view.on_tray),
        'advice': view.reason,
        'images, flips': f'{view.images}, {view.flips}',
        'picks': f'{view.picks}' + (f' ({view.missed} missed)' if view.missed else ''),
        'parts per minute': number_text(view.rate),
        'forecast': f'{view.forecast_text}, 95 % of runs of {view.total:g} min',
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def feeder_line(view: FeederView) -> str:
    """Return the state of a running feeder in a line, for a log."""
    return (
        f'{view.time} of {view.total:g} min: {view.picks} picks, {number_text(view.rate)} per '
        f'minute (forecast {view.forecast_text})'
    )


def feeder_sentence(view: FeederView, seconds: float) -> str:
    """Return what a run has shown, in plain sentences.

    seconds : real duration
    """
    text = (
        f'In {view.time} minutes of simulated time, which took {seconds:.0f} s, the robot picked '
        f'{view.picks} parts: {number_text(view.rate)} per minute. The forecast is '
        f'{number_text(view.forecast)}, and {number_text(view.lower)} to '
        f'{number_text(view.upper)} for 95 % of the runs of {minutes_text(view.total)}'
    )
    if view.minutes < view.total:
        return f'{text}; this run was shorter.'
    inside = view.lower <= view.rate <= view.upper
    return f'{text}; this run lies {"within" if inside else "outside"} that interval.'
