"""JSON fields of a forecast of parts per minute, in SI units."""

import dataclasses
from typing import Any

from resting_aspects_ros.feeding.steady_state import cycle_time
from resting_aspects_ros.report.document import plain
from resting_aspects_ros.report.forecast_table import NamedForecast, forecast_sentence

_SIZES = ('length', 'width', 'radius')


def forecast_fields(named: NamedForecast) -> dict[str, Any]:
    """Return a forecast as plain JSON types.

    Returns
    -------
    dict
        ``sentence``: the result in words. ``parts_per_minute`` in the long run, with its bounds
        ``lower`` and ``upper``; ``prediction_lower`` and ``prediction_upper`` for a run of
        ``minutes``. ``parts_on_tray``, and ``best_number``, which is null if no part can be
        picked; ``best_number_is_limit``: whether it is only the largest number for which the model
        holds. ``flips_per_part``: the mean number of flips of a part from its supply until it is
        picked, null if it never is. ``empty_cycles``: the share of cycles without a pick.
        ``picks_per_cycle``, ``cycle_time`` s, ``supplied_per_cycle``. ``coverage``: the share of
        the tray that parts cover. ``limited_by``: robot, feeder or vision; null if nothing
        can be picked. ``times``: s.
        ``time_shares`` of a mean cycle. ``sensitivity``: change of the rate in % if a time is 10 %
        ``shorter`` or ``longer``. ``curve``: the same quantities for several numbers of parts.
        ``mix``: for each row, an aspect or a symmetry class, the shares of a ``drop`` and of the
        parts ``on_tray`` in an image, the probability that a part is ``free`` and ``picked``, and
        ``length`` and ``width`` seen from above, m.
    """
    model, found = named.model, named.forecast
    gripper = model.tray.gripper
    state, curve = found.state, found.curve
    lower, upper = found.prediction
    drop = model.drop / model.drop.sum()
    rows = zip(named.rows, model.footprints, drop.tolist(), strict=True)
    document = {
        'sentence': forecast_sentence(named),
        'parts_per_minute': found.rate,
        'lower': found.lower,
        'upper': found.upper,
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
        'curve': [
            dict(zip(_POINT, point, strict=True))
            for point in zip(
                curve.number.tolist(),
                curve.rate.tolist(),
                curve.lower.tolist(),
                curve.upper.tolist(),
                curve.empty_cycles.tolist(),
                curve.free.tolist(),
                strict=True,
            )
        ],
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


_POINT = ('number', 'parts_per_minute', 'lower', 'upper', 'empty_cycles', 'free')
