"""Search for the point of the unit cube with the best score, by drops and a surrogate.

Drops at a Sobol design, a surrogate of the shares, then rounds of drops at points that draws of
the surrogate prefer (Thompson sampling), until no point can be much better or the drops are used.
The search knows neither parts nor conditions, so that it can be tested with known functions.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, analysis
from resting_aspects_ros.studies.design import sobol
from resting_aspects_ros.studies.optimum_problem import Amounts, Array, Counts, Problem
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate

# Number of rounds into which the drops of the search are divided.
ROUNDS = 6
# Candidates: points of a Sobol sequence, as many with some coordinates at a bound, and points near
# the best one.
SPREAD, NEARBY = 512, 256
# Standard deviations of the points near the best one.
NEAR = (0.15, 0.05, 0.015)
# Draws of the surrogate from which means are computed.
DRAWS = 200
# The search ends if the expected gain of any other point is below this share of the tolerance, but
# not before these rounds, whose drops near the best point show whether the surrogate is right.
CERTAIN = 0.25
MIN_ROUNDS = 2
# Points whose coordinates all differ by less than this are nearly the same conditions.
NEARLY_SAME = 0.2
# Points closer to an impossible one than this are not proposed.
TOO_NEAR = 0.02
# Proposals that are impossible in succession, after which the search gives up.
MAX_IMPOSSIBLE = 200


@dataclass(eq=False)
class OptimumSearch:
    """The points so far, their counts, and the surrogate.

    points, counts : list of (d,) float and of (c,) int
    rounds : list of int
        Round of each point: 0 for the design.
    skipped : list of ((d,) float, str)
        Impossible points, and why.
    """

    problem: Problem
    amounts: Amounts
    seed: int
    points: list[Array] = field(default_factory=list)
    counts: list[Counts] = field(default_factory=list)
    rounds: list[int] = field(default_factory=list)
    skipped: list[tuple[Array, str]] = field(default_factory=list)
    certain: bool = False
    surrogate: ShareSurrogate | None = None

    @property
    def drops(self) -> int:
        """Number of drops so far."""
        return int(sum(each.sum() for each in self.counts))

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Make the drops; returns early if ``stopped``. Raises InvalidValueError, EngineError."""
        problem, amounts = self.problem, self.amounts
        design = problem.snapped(sobol(problem.dimensions, amounts.points, self.seed))
        possible = [p for p in _unique(design) if self._possible(p)]
        if len(possible) < 2:
            reason = f': {self.skipped[0][1]}' if self.skipped else ''
            raise InvalidValueError(
                f'invalid ranges: expected at least 2 possible points, not {len(possible)} of '
                f'{amounts.points}{reason}'
            )
        self._drop(possible, 0)
        size = max(1, (amounts.search - self.drops) // amounts.drops // ROUNDS)
        for number in range(1, amounts.search // amounts.drops):
            if not self._fit(number) or stopped():
                return
            left = (amounts.search - self.drops) // amounts.drops
            gain = self._expected_gain(number)
            self.certain = number > MIN_ROUNDS and gain < CERTAIN * problem.tolerance
            if self.certain or left < 1:
                return
            self._drop(self._proposed(min(size, left), number), number)

    def predicted(self, points: Array) -> Array:
        """Return mean scores (n,) at points (n, d), over draws of the surrogate."""
        assert self.surrogate is not None
        return self.drawn(points, DRAWS).mean(axis=0)

    def drawn(self, points: Array, size: int) -> Array:
        """Return draws (size, n) of the scores at points (n, d), by the surrogate."""
        assert self.surrogate is not None
        rng = np.random.default_rng((self.seed, 2))
        return self.problem.scores(self.surrogate.draws(points, rng, size))

    def best(self) -> Array:
        """Return the possible point (d,) with the largest mean score; see `rival`."""
        for _ in range(MAX_IMPOSSIBLE):
            found = self._argmax(0, self.points[0])
            for _ in NEAR:
                found = self._argmax(0, found)
            if self._possible(found):
                return found
        return max(self.points, key=lambda p: float(self.predicted(p[None])[0]))

    def rival(self, best: Array) -> Array | None:
        """Return the best possible point that is not nearly the same; None if there is none."""
        for _ in range(MAX_IMPOSSIBLE):
            points = self._far(self._candidates(1, best), best)
            if not len(points):
                return None
            found = points[np.argmax(self.predicted(points))]
            points = self._far(self._candidates(1, found), best)
            found = points[np.argmax(self.predicted(points))]
            if self._possible(found):
                return np.asarray(found)
        return None

    def _far(self, points: Array, best: Array) -> Array:
        return np.asarray(points[np.abs(points - best).max(axis=1) >= NEARLY_SAME])

    def _possible(self, point: Array) -> bool:
        reason = self.problem.impossible(point)
        if reason:
            self.skipped.append((point, reason))
        return not reason

    def _drop(self, points: list[Array], number: int) -> None:
        if not points:
            return
        counts = self.problem.counts(np.array(points), self.amounts.drops, f'round {number}')
        for point, row in zip(points, counts, strict=True):
            if row.sum():
                self.points.append(point)
                self.counts.append(row)
                self.rounds.append(number)

    def _fit(self, number: int) -> bool:
        """Fit the surrogate; returns False if there are too few points, or if it fails."""
        if len(self.points) < 2:
            return False
        rng = np.random.default_rng((self.seed, 1, number))
        points, counts, fitted = np.array(self.points), np.array(self.counts), None
        with analysis(f'the surrogate of round {number}'):
            fitted = self.surrogate = ShareSurrogate.fit(points, counts, rng)
        return fitted is not None

    def _expected_gain(self, number: int) -> float:
        """Return by how much the best point of a draw is better than the best one, on average."""
        points = self._candidates(number, self._argmax(number, self.points[0]))
        scores = self.drawn(points, DRAWS)
        best = scores.mean(axis=0).argmax()
        return float((scores.max(axis=1) - scores[:, best]).mean())

    def _proposed(self, size: int, number: int) -> list[Array]:
        """Return possible points, each the best one of a draw of the surrogate."""
        assert self.surrogate is not None
        points = self._candidates(number, self._argmax(number, self.points[0]))
        rng = np.random.default_rng((self.seed, 3, number))
        found: list[Array] = []
        for _ in range(MAX_IMPOSSIBLE):
            scores = self.problem.scores(self.surrogate.draws(points, rng, 1))[0]
            # The same point twice tells less than two points.
            for chosen in found:
                scores[(points == chosen).all(axis=1)] = -np.inf
            best = int(scores.argmax())
            if not np.isfinite(scores[best]):
                break
            if self._possible(points[best]):
                found.append(points[best])
            else:
                points = self._not_like_skipped(points)
            if len(found) == size or not len(points):
                break
        return found

    def _argmax(self, number: int, near: Array) -> Array:
        points = self._candidates(number, near)
        return np.asarray(points[np.argmax(self.predicted(points))])

    def _candidates(self, number: int, near: Array) -> Array:
        """Return points (n, d) among which the best one is sought, also at the bounds."""
        d = self.problem.dimensions
        rng = np.random.default_rng((self.seed, 4, number))
        spread = sobol(d, SPREAD, self.seed + 1)
        bounds = np.where(rng.random((SPREAD, d)) < 0.5, spread.round(), spread)
        scale = np.repeat(NEAR, NEARBY // len(NEAR))[:, None]
        close = np.clip(near + scale * rng.standard_normal((len(scale), d)), 0, 1)
        # Some of the other coordinates of near points stay as they are.
        close = np.where(rng.random(close.shape) < 0.3, near, close)
        points = np.vstack([near[None], self.points, spread, bounds, close])
        return self._not_like_skipped(_unique(self.problem.snapped(points)))

    def _not_like_skipped(self, points: Array) -> Array:
        """Return the points that are nearer to a possible point than to an impossible one."""
        if not self.skipped:
            return points
        bad = np.array([point for point, _ in self.skipped])
        good = np.array(self.points)
        far = _distance(points, bad)
        return np.asarray(points[(far > _distance(points, good)) & (far > TOO_NEAR**2)])


def _distance(points: Array, others: Array) -> Array:
    """Return the squared distance (n,) of points to the nearest of others."""
    return np.asarray(((points[:, None] - others[None]) ** 2).sum(axis=2).min(axis=1))


def _unique(points: Array) -> Array:
    """Return the points without repetitions, in their order."""
    _, first = np.unique(points, axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])
