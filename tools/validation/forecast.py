"""Validation of forecasts: SimPy, coverage of the intervals with a controller, false alarms."""

import dataclasses
import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from rich.console import Console
from rich.progress import track

from resting_aspects_ros.feeding.control import advise, controller_model
from resting_aspects_ros.feeding.footprint import Footprint, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    Moves,
    drawn_moves,
    moves_of,
    parts_per_minute,
    run_spread,
    steady_state,
)
from resting_aspects_ros.feeding.tray_simulation import (
    DensityPlaces,
    forecast_controller,
    simulate,
)
from resting_aspects_ros.statistics.comparison import p_of_window
from resting_aspects_ros.statistics.drift import parts_needed
from validation.dropper import SEED
from validation.feeder_events import simulated_picks

DROP = np.array([600, 300, 100])
ACTIONS = np.array(
    [[300, 80, 19, 1, 0, 0, 0], [150, 200, 45, 0, 5, 0, 0], [50, 50, 290, 0, 0, 0, 10]]
)
FREE = np.array([0.0, 0.7, 0.4])
TIMES = CycleTimes(robot=1.2, vibrate=0.8, settle=0.5, image=0.2, supply=0.05)
OVERLAP = dataclasses.replace(TIMES, place=0.6)
# Number of parts, times, and maximum of picks.
CASES: dict[str, tuple[int, CycleTimes, int | None]] = {
    '12 parts': (12, TIMES, None),
    '12 parts, overlap': (12, OVERLAP, None),
    '12 parts, overlap, at most 2 picks': (12, OVERLAP, 2),
    '20 parts, at most 4 picks': (20, TIMES, 4),
    '2 parts, overlap': (2, OVERLAP, None),
    '1 part, overlap': (1, OVERLAP, None),
}
MINUTES, PIECE = 2500, 5
# Random feeders, runs of each, and their lengths, minutes.
FEEDERS, RUNS, LENGTHS = 30, 10, (5.0, 20.0)
# Shares of the classes, simulated drops, and level.
DRIFT = [
    ((0.27, 0.28, 0.24, 0.13, 0.08), 10_000, 0.05),
    ((0.27, 0.28, 0.24, 0.13, 0.08), 1000, 0.01),
    ((0.72, 0.28), 10_000, 0.05),
    ((0.9, 0.07, 0.03), 2000, 0.05),
]
REPETITIONS = 4000


def _shown(total: int, name: str) -> Iterator[int]:
    yield from track(range(total), name, console=Console(stderr=True), transient=True)


def formulas() -> Iterator[str]:
    """Compare the rates of the formulas with those of a discrete-event simulation."""
    yield '### Formulas and discrete events'
    yield ''
    yield (
        f'Runs of {MINUTES} minutes with SimPy: processes of feeder and robot, single parts. '
        '*SE*: standard errors of the simulated rate. The variance is that of the picks in a '
        f'minute, from pieces of {PIECE} minutes, with its standard error.'
    )
    yield ''
    yield (
        '| case | picks | formula (1/min) | SimPy (1/min) | difference (SE) '
        '| variance: formula | SimPy |'
    )
    yield '|---|---|---|---|---|---|---|'
    moves = moves_of(DROP, ACTIONS)
    for name, (number, times, most) in CASES.items():
        state = steady_state(moves, FREE, number, most)
        rate = float(parts_per_minute(times, state.picks, state.supplied))
        variance = run_spread(moves, state, number, times).variance
        picks = simulated_picks(moves, FREE, number, times, most, 60 * MINUTES, SEED)
        error = math.sqrt(variance / MINUTES)
        pieces = np.histogram(picks, bins=MINUTES // PIECE, range=(0, 60 * MINUTES))[0]
        found = pieces.var(ddof=1) / PIECE
        yield (
            f'| {name} | {len(picks)} | {rate:.3f} | {len(picks) / MINUTES:.3f} '
            f'| {(len(picks) / MINUTES - rate) / error:+.1f} | {variance:.2f} '
            f'| {found:.2f} ± {found * math.sqrt(2 / (len(pieces) - 1)):.2f} |'
        )
    yield ''


def random_feeder(generator: np.random.Generator) -> FeederModel:
    """Return a feeder with 2 to 5 aspects, of which few drops and actions are known."""
    k = int(generator.integers(2, 6))
    rows = generator.dirichlet(np.append(np.ones(k), 0.1), k)
    keep = generator.uniform(0, 0.7)
    rows[:, :k] = (1 - keep) * rows[:, :k] + keep * np.diag(rows[:, :k].sum(axis=1))
    actions = int(generator.integers(20, 150))
    counts = np.array([generator.multinomial(actions, row) for row in rows])
    drops = generator.multinomial(
        int(generator.integers(100, 600)), generator.dirichlet(np.ones(k))
    )
    pickable = np.zeros(k, dtype=np.bool_)
    pickable[generator.permutation(k)[: int(generator.integers(1, max(k - 1, 1) + 1))]] = True
    sizes = generator.uniform(0.01, 0.03, (k, 2))
    robot = generator.uniform(0.4, 2)
    times = CycleTimes(
        robot=robot,
        vibrate=generator.uniform(0.3, 2),
        settle=generator.uniform(0.2, 1),
        image=generator.uniform(0.1, 1),
        supply=float(generator.choice([0, 0.1])),
        place=robot / 2 if generator.random() < 0.3 else 0.0,
    )
    most = None if generator.random() < 0.7 else int(generator.integers(1, 5))
    footprints = [Footprint(float(max(size)), float(min(size))) for size in sizes]
    tray = Tray((0.2, 0.2), float(generator.uniform(0.002, 0.008)))
    return FeederModel(drops, counts, pickable, footprints, tray, times, most)


def coverage() -> Iterator[str]:
    """Count how many runs with a controller lie in the prediction interval."""
    yield '### Prediction interval with a controller'
    yield ''
    yield (
        f'{FEEDERS} random feeders with 2 to 5 classes, 100 to 600 drops, and 20 to 150 flips '
        f'from each class. {RUNS} runs of each: the true shares and transitions are drawn from '
        'their posterior, and `feeder_controller` decides with the counts. The trays are those of '
        'the density model. *Within*: runs in the 95 % prediction interval of '
        '`forecast_controlled`.'
    )
    yield ''
    yield '| minutes of a run | runs | within | share | feeders with 8 or more of 10 within |'
    yield '|---|---|---|---|---|'
    for minutes in LENGTHS:
        within = [_within(k, minutes) for k in _shown(FEEDERS, f'runs of {minutes:g} min')]
        share = sum(within) / (FEEDERS * RUNS)
        # Of the runs of a feeder, which share an interval.
        error = np.std(within, ddof=1) / RUNS / math.sqrt(FEEDERS)
        yield (
            f'| {minutes:g} | {FEEDERS * RUNS} | {sum(within)} | {share:.3f} ± {error:.3f} '
            f'| {sum(each >= 8 for each in within)} of {FEEDERS} |'
        )
    yield ''


def _within(seed: int, minutes: float) -> int:
    generator = np.random.default_rng([SEED, seed])
    model = controller_model(random_feeder(generator))
    low, high = forecast_controller(
        model, minutes, places=lambda each: DensityPlaces(model, each)
    ).prediction
    drawn = drawn_moves(model.feeder.drop, model.feeder.transitions, RUNS, generator)
    found = 0
    for k in range(RUNS):
        moves = Moves(drawn.drop[k], drawn.transitions[k], drawn.left[k])
        decide = partial(advise, model=model)
        run = simulate(decide, model, 60 * minutes, generator.spawn(1)[0], moves=moves)
        found += bool(low <= np.searchsorted(run.picked, 60 * minutes) / minutes <= high)
    return found


def false_alarms() -> Iterator[str]:
    """Compare the share of windows without drift that are alarms with the level."""
    yield '### False alarms of the drift test'
    yield ''
    yield (
        f'{REPETITIONS} windows without drift, each with its own simulated drops. A window has '
        'about the number of parts that finds a shift of 5 points with a probability of 80 %, and '
        'at most half as many parts as drops. The standard error is that of the level.'
    )
    yield ''
    yield '| shares of the classes (%) | drops | parts in a window | level | alarms | share |'
    yield '|---|---|---|---|---|---|'
    for shares, drops, level in DRIFT:
        generator = np.random.default_rng(SEED)
        simulated = np.round(drops * np.array(shares)).astype(np.int64)
        parts = min(drops // 2, parts_needed(10 * simulated, 0.05, level))
        alarms = 0
        for _ in _shown(REPETITIONS, 'windows'):
            window = generator.multinomial(parts, shares)
            alarms += (
                p_of_window(window, generator.multinomial(drops, shares), generator, level)
                <= level
            )
        share = alarms / REPETITIONS
        error = math.sqrt(level * (1 - level) / REPETITIONS)
        yield (
            f'| {", ".join(f"{100 * each:g}" for each in shares)} | {drops} | {parts} | {level:g} '
            f'| {alarms} | {share:.3f} ± {error:.3f} |'
        )
    yield ''
