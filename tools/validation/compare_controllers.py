"""Comparison of the controller of the feeder with rules of today, on simulated trays.

`python -m validation.compare_controllers [--seeds 40] [--minutes 60] [--positions]` prints a table
in Markdown. With 24 seeds of 60 minutes it takes about 8 minutes on one core; with --positions,
which places the outlines on the tray instead of using the density model, several times as long.
"""

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

import resting_aspects_ros as ra
from resting_aspects_ros.api.forecast import CLEARANCE, TRAY, forecast_from
from resting_aspects_ros.feeding.control import (
    Advice,
    Controller,
    ControllerModel,
    PartValues,
    SeenPart,
    advise,
    controller_model,
    flip_and_refill,
    hopper_rule,
    supply_below,
)
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import simulate

# Pickable classes of each part.
PARTS = {'l_bracket': [3], 't_prism': [1]}
TIMES = {
    'robot': CycleTimes(robot=1.5, vibrate=0.5, settle=0.3, image=0.15, supply=0.05),
    'feeder': CycleTimes(robot=0.4, vibrate=2.0, settle=1.0, image=0.2, supply=0.1),
    'vision': CycleTimes(robot=0.4, vibrate=0.4, settle=0.3, image=1.5, supply=0.05),
}
DROPS, PER_ASPECT = 1000, 300
ITERATIONS = 3
SPREAD = 0.5  # duration of a spread as a share of that of a flip
Rules = Mapping[str, Callable[[ControllerModel], Controller]]
BASELINES: Rules = {
    'flip when none can be picked': lambda model: flip_and_refill(model, look=True),
    'refill below half': lambda model: supply_below(model, max(model.best_number // 2, 1)),
    'hopper rule': lambda model: hopper_rule(model, max(model.best_number // 2, 1)),
    'refill and flip at once': flip_and_refill,
}


def without_values(model: ControllerModel) -> Controller:
    """Return the controller that neglects the value of the parts that are left on the tray."""
    return partial(advise, model=_with_rate(model, model.values.rate))


def greedy(model: ControllerModel) -> Controller:
    """Return the controller that maximises the picks up to the next image over their time.

    The maximum of the ratio is found by Dinkelbach's iteration: the rate by which time is valued
    is that of the best choice with the rate before.
    """

    def decide(seen: Sequence[SeenPart]) -> Advice:
        rate = model.values.rate
        advice = advise(seen, _with_rate(model, rate))
        for _ in range(ITERATIONS):
            best = advice.expected.get(advice.choice)
            if best is None or best.picks <= 0:
                return advice
            rate = best.picks / best.seconds
            advice = advise(seen, _with_rate(model, rate))
        return advice

    return decide


def _with_rate(model: ControllerModel, rate: float) -> ControllerModel:
    """Return a model in which a second costs this rate, and parts on the tray have no value."""
    nothing = np.zeros_like(model.values.part)
    changed = dataclasses.replace(model)
    # The value of the cached property.
    vars(changed)['values'] = PartValues(rate, model.values.mix, nothing, 0.0)
    vars(changed)['moves'] = model.moves
    return changed


def rates(
    controller: Controller, model: ControllerModel, seeds: int, minutes: float, positions: bool
) -> npt.NDArray[np.float64]:
    """Return the parts per minute of a run with each seed."""
    return np.array(
        [
            simulate(
                controller, model, 60 * minutes, np.random.default_rng(seed), positions=positions
            ).rate
            for seed in range(1, seeds + 1)
        ]
    )


# Other criteria of the same controller.
CRITERIA: Rules = {'greedy ratio': greedy, 'gain without values of parts': without_values}
RULES = {**BASELINES, **CRITERIA}


def compared(ours: npt.NDArray[np.float64], theirs: npt.NDArray[np.float64]) -> str:
    """Return the mean of the paired differences in percent of theirs, with the standard error."""
    difference = 100 * (ours - theirs) / theirs.mean()
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return f'{difference.mean():+.2f} ± {error:.2f}'


def scenarios(
    seeds: int, minutes: float, rules: Rules, positions: bool = False, spread: bool = False
) -> Iterator[str]:
    """Compare the controller with rules for each part and set of times; yields the table."""
    heads = ['part, limited by', 'parts on tray', 'forecast of the cycle', 'controller, parts/min']
    heads += [f'% above "{name}"' for name in rules]
    heads += ['with spread: % above controller without'] if spread else []
    yield '| ' + ' | '.join(heads) + ' |'
    yield '|---' * len(heads) + '|'
    for part, classes in PARTS.items():
        result = ra.reorient(part, 'flip', PER_ASPECT, drops=DROPS, seed=1)
        ids = result.matrix.aspects.chosen(None, classes, 'pickable')
        for limit, times in TIMES.items():
            found = forecast_from(result, ids, Tray(TRAY, CLEARANCE), times).named.model
            plain = controller_model(found)
            vibrating = controller_model(found, spread=SPREAD * times.vibrate)
            rate = partial(
                rates, model=vibrating, seeds=seeds, minutes=minutes, positions=positions
            )
            ours = rate(partial(advise, model=plain))
            row = [f'{part}, {limit}', str(plain.best_number), f'{60 * plain.values.rate:.2f}']
            row += [f'{ours.mean():.2f}']
            row += [compared(ours, rate(make(plain))) for make in rules.values()]
            row += [compared(rate(partial(advise, model=vibrating)), ours)] if spread else []
            yield '| ' + ' | '.join(row) + ' |'


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=40)
    parser.add_argument('--minutes', type=float, default=60)
    parser.add_argument('--positions', action='store_true')
    args = parser.parse_args()
    for line in scenarios(args.seeds, args.minutes, RULES, args.positions, spread=True):
        sys.stdout.write(f'{line}\n')
        sys.stdout.flush()


if __name__ == '__main__':
    main()
