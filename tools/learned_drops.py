"""The drops from which the learned estimator is fitted: which conditions, and how many.

Each solid of the training set is dropped twice: under the conditions of a Sobol design, and under
those of a band, which is a surface for parts of different sizes. Only the proportions of a part
matter, so heights, speeds and times are in units of its hull radius R and of T = sqrt(R / g).
"""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from learned_solids import KINDS, kind_of, solid
from scipy.stats import qmc

from resting_aspects_ros.api.recommended_method import without_dimension
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.estimators.release import Bounds, Release
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.simulation.conditions import DropConditions, HeightOf
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.surfaces import Surfaces

Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
TRAINING, TEST = 1, 2
# Hull radii, m, of the parts in the bands of the named surfaces.
RADII = (0.005, 0.06)
BANDS = ('rubber_mat', 'steel', 'thrown', 'frictionless')
GRAVITY = 9.81
# Bounds of the design, in R and T; heights and rolling friction on a logarithmic scale.
HEIGHT = (0.05, 30.0)
RESTITUTION = (0.0, 0.85)
FRICTION = (0.0, 0.8)
ROLLING = (0.0003, 0.02)
SPEED, SPEED_VERTICAL, SPIN = 3.0, 1.0, 3.0
# Conditions for which the estimator is fitted: the design, and smooth or frictionless surfaces.
BOUNDS = Bounds(
    height=HEIGHT,
    restitution=RESTITUTION,
    friction=FRICTION,
    rolling_friction=(0.0, ROLLING[1]),
    speed=(0.0, SPEED),
    speed_vertical=(0.0, SPEED_VERTICAL),
    spin=(0.0, 4.0),  # thrown parts of 60 mm
)


@dataclass(frozen=True)
class Case:
    """A solid, and the conditions under which it is dropped."""

    seed: int
    index: int
    band: str
    release: Release
    drops: int

    @property
    def kind(self) -> str:
        """Kind of the solid."""
        return kind_of(self.index)

    @property
    def solid(self) -> tuple[int, int]:
        """Seed and index of the solid."""
        return self.seed, self.index

    @property
    def key(self) -> tuple[int, int, str]:
        """What distinguishes it from other cases of a data set."""
        return self.seed, self.index, self.band


def shape_of(seed: int, index: int) -> RestingShape:
    """Return a solid of the data set."""
    return RestingShape(solid(seed, index))


def training_cases(index: int, drops: int = CHUNK) -> list[Case]:
    """Return the two cases of a solid of the training set."""
    band = BANDS[(index // len(KINDS)) % len(BANDS)]
    return [
        Case(TRAINING, index, 'design', design(index), drops),
        Case(TRAINING, index, band, in_band(TRAINING, index, band), drops),
    ]


def held_out_cases(drops: int) -> list[Case]:
    """Return a case for each kind and band, and for the design, of solids that are not fitted."""
    found = []
    for row, band in enumerate((*BANDS, 'design')):
        for column in range(len(KINDS)):
            index = row * len(KINDS) + column
            release = design(500_000 + index) if band == 'design' else in_band(TEST, index, band)
            found.append(Case(TEST, index, band, release, drops))
    return found


@lru_cache(maxsize=4)
def _sobol(block: int) -> Array:
    engine = qmc.Sobol(8, rng=np.random.default_rng(TRAINING))
    if block:
        engine.fast_forward(1024 * block)
    return np.asarray(engine.random(1024))


def design(index: int) -> Release:
    """Return a point of the Sobol design. Half of the parts are released at rest."""
    u = _sobol(index // 1024)[index % 1024]
    thrown = u[4] > 0.5
    return Release(
        height=_logarithmic(u[0], HEIGHT),
        restitution=_linear(u[1], RESTITUTION),
        friction=_linear(float(u[2]) ** 1.5, FRICTION),
        rolling_friction=_logarithmic(u[3], ROLLING),
        speed=float(SPEED * u[5]) if thrown else 0.0,
        speed_vertical=float(SPEED_VERTICAL * u[6]) if thrown else 0.0,
        spin=float(SPIN * u[7]) if thrown else 0.0,
    )


def in_band(seed: int, index: int, band: str) -> Release:
    """Return conditions of a band: a surface for a part of random size, or a frictionless one.

    The frictionless hard surface is that of the study of Varkonyi (2014).
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index, 1)))
    if band == 'frictionless':
        height, restitution = _logarithmic(rng.random(), (0.5, 20.0)), rng.uniform(0.2, 0.8)
        return Release(height, restitution, friction=0.0, rolling_friction=0.0)
    return without_dimension(_surfaces().get(band), _logarithmic(rng.random(), RADII))


@lru_cache(maxsize=1)
def _surfaces() -> Surfaces:
    return Surfaces.read(ROOT / 'config' / 'surfaces.yaml')


def _linear(u: float, bounds: tuple[float, float]) -> float:
    return float(bounds[0] + u * (bounds[1] - bounds[0]))


def _logarithmic(u: float, bounds: tuple[float, float]) -> float:
    return float(bounds[0] * (bounds[1] / bounds[0]) ** u)


def conditions_of(release: Release, radius: float) -> DropConditions:
    """Return the conditions for a part with the hull radius R, m."""
    unit = math.sqrt(radius / GRAVITY)
    return DropConditions(
        height=release.height * radius,
        restitution=release.restitution,
        friction=release.friction,
        rolling_friction=release.rolling_friction,
        spinning_friction=0.0,
        gravity=GRAVITY,
        speed_horizontal=release.speed * radius / unit,
        speed_vertical=release.speed_vertical * radius / unit,
        spin=release.spin / unit,
        height_of=HeightOf.LOWEST_POINT,
    )


def job_of(case: Case, shape: RestingShape) -> DropJob:
    """Return the job with which the drops of a case are simulated."""
    conditions = conditions_of(case.release, shape.part.hull_radius)
    return make_job(shape.part, conditions, case.index, landscape=shape.landscape)


def counted(aspects: AspectSet, poses: RestingPoses) -> list[int]:
    """Return the counts of the aspects, and last that of all other drops."""
    settled = poses.status == RestStatus.SETTLED
    ids = np.where(settled, aspects.classify(poses.orientation), 0)
    counts = np.bincount(ids, minlength=len(aspects) + 1)
    return [*counts[1:].tolist(), int(counts[0])]


def line(case: Case, counts: list[int]) -> str:
    """Return a case and its counts as a line of the data set."""
    release = {name: float(f'{value:.9g}') for name, value in asdict(case.release).items()}
    return json.dumps(
        {'seed': case.seed, 'index': case.index, 'kind': case.kind, 'band': case.band}
        | {'release': release, 'counts': counts}
    )


def read_lines(path: Path) -> Iterator[tuple[Case, list[int]]]:
    """Yield the cases of a data set and their counts; a line that was broken off is ignored."""
    if not path.exists():
        return
    for text in path.read_text(encoding='utf-8').splitlines(keepends=True):
        if text.endswith('\n'):
            d = json.loads(text)
            release, drops = Release(**d['release']), sum(d['counts'])
            yield Case(d['seed'], d['index'], d['band'], release, drops), d['counts']
