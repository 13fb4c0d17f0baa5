"""The problem of a part: points of the unit cube as conditions, under which it is dropped."""

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.studies.action_points import act_at_points, check_action_point
from resting_aspects_ros.studies.design import Factor, Setting, on_levels, point_values
from resting_aspects_ros.studies.objectives import Array, Counts, Objective
from resting_aspects_ros.studies.point_runs import drop_points


class PartProblem:
    """What is optimised: an objective of a part over factors; see optimum_problem.Problem.

    progress : callable
        Called often, with the number of drops made so far.
    stopped : callable
        Ends early if it returns True; unfinished points then have fewer drops, or none.
    """

    def __init__(
        self,
        part: Part,
        factors: Sequence[Factor],
        base: Setting,
        objective: Objective,
        seed: int,
        workers: Workers,
        landscape: Landscape,
        *,
        progress: Callable[[int], None] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.factors = tuple(factors)
        self.base = base
        self.dimensions = len(factors)
        self.tolerance = objective.tolerance
        self.scores = objective.scores
        self.done = 0
        self._part, self._objective, self._seed = part, objective, seed
        self._workers, self._progress, self._stopped = workers, progress, stopped
        self._landscape = landscape
        self._aspects = find_aspects(part, landscape)

    def setting(self, point: Array) -> Setting:
        """Return what is simulated at a point (d,); raises InvalidValueError if impossible."""
        return self.base.changed(point_values(self.factors, point[None])[0])

    def impossible(self, point: Array) -> str:
        """Return why a point cannot be simulated; empty if it can."""
        try:
            self.check(self.setting(point))
        except InvalidValueError as error:
            return str(error)
        return ''

    def check(self, setting: Setting) -> None:
        """Raise InvalidValueError if a setting cannot be simulated."""
        check_action_point(self._part, setting, self._landscape, self._aspects)

    def snapped(self, points: Array) -> Array:
        """Return the nearest points (n, d) that the factors allow."""
        return on_levels(points, self.factors)

    def counts(self, points: Array, drops: int, batch: str) -> Counts:
        """Return counts (m, c) of the outcomes at points (m, d)."""
        return self.counts_at([self.setting(point) for point in points], drops, batch)

    def counts_at(self, settings: Sequence[Setting], drops: int, batch: str) -> Counts:
        """Return counts (m, c) of the outcomes of settings; drops of batches are independent."""
        digest = hashlib.sha256(f'{self._seed} {batch}'.encode()).digest()
        seed, before = int.from_bytes(digest[:8], 'little'), self.done

        def progress(done: int) -> None:
            self.done = before + done
            self._progress(self.done)

        if self.base.action is None:
            found = drop_points(
                self._part,
                settings,
                drops,
                seed,
                workers=self._workers,
                progress=progress,
                stopped=self._stopped,
                landscape=self._landscape,
                contacts=self._objective.contacts,
            )
        else:
            found = act_at_points(
                self._part,
                settings,
                drops,
                seed,
                self._workers,
                progress=progress,
                stopped=self._stopped,
                landscape=self._landscape,
            )
        return self._objective.columns(found.counts, found.other)

    def values(self, point: Array) -> dict[str, float]:
        """Return the values of the factors at a point (d,), SI units."""
        return point_values(self.factors, point[None])[0]


def setting_value(setting: Setting, name: str) -> float | None:
    """Return the value of a factor in a setting, SI units; None if it has a default there."""
    group, dot, inner = name.partition('.')
    if not dot:
        return float(getattr(setting.conditions, name))
    if group == 'action':
        assert setting.action is not None
        return float(getattr(setting.action.action, inner))
    assert setting.surroundings is not None
    found: Any = setting.surroundings.shape_values
    body, dot, value = inner.partition('.')
    if dot:
        known = setting.surroundings
        found = known.release if body == 'release' else known.bodies.get(body, {})
        default = getattr(setting.conditions, value, None)
        return None if found.get(value, default) is None else float(found.get(value, default))
    return float(found[inner])
