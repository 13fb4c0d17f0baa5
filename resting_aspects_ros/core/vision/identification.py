"""Which part, in which aspect and where, an observed polygon shows, with probabilities.

The answers are the classes of the known parts, 'none of these' and 'touching parts'. The posterior
of an answer is proportional to prior times likelihood; see `likelihood` for known and unknown
outlines. Touching parts are not a known outline either: see `touching` for the ratio of the two.
For a pinhole camera, the known outlines are what it sees of the parts there; see `perspective`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import affinity

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.vision.camera import Pinhole, Telecentric
from resting_aspects_ros.core.vision.candidate import Candidate
from resting_aspects_ros.core.vision.fitting import Shape
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.core.vision.likelihood import (
    OutlineNoise,
    log_sum,
    unknown_likelihood,
)
from resting_aspects_ros.core.vision.perspective import perspective_fits
from resting_aspects_ros.core.vision.rolling_fit import NEGLIGIBLE, ViewFit, class_fits
from resting_aspects_ros.core.vision.surface_views import SurfaceViews
from resting_aspects_ros.core.vision.touching import touching_odds

# Prior probabilities that a polygon shows none of the known parts, or several that touch.
NONE_PRIOR, TOUCHING_PRIOR = 0.01, 0.03
# Outlines that differ at least so much, as a multiple of the noise, are not fitted, except for the
# nearest.
FAR, NEAREST = 8.0, 2
# Polygons fit as well as others if the logarithms of their likelihoods differ by less.
AS_WELL = 3.0
# The prior share of a class is at least this, because a share that was never seen is not zero.
MIN_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class Identification:
    """What an observed polygon may show.

    candidates : tuple of Candidate
        By posterior, descending; those that are far from the polygon are left out, except for the
        nearest.
    none : float
        Posterior probability that the polygon shows none of the known parts.
    touching : float
        Posterior probability that it shows several known parts that touch or overlap.
    effective_samples : float
        n, the number of independent errors of the boundary.
    mirrored : tuple of Candidate
        Candidates that fit the mirror image of the polygon as well as the first one fits the
        polygon, which they do not fit. If y is down in the coordinates, they are right instead.
    """

    candidates: tuple[Candidate, ...]
    none: float
    touching: float
    effective_samples: float
    mirrored: tuple[Candidate, ...] = ()

    @property
    def answer(self) -> str:
        """'part', 'none' or 'touching', whichever is most probable."""
        if 1 - self.none - self.touching >= max(self.none, self.touching):
            return 'part'
        return 'none' if self.none >= self.touching else 'touching'

    @property
    def best(self) -> Candidate | None:
        """The most probable candidate; None if the answer is not a part."""
        return self.candidates[0] if self.answer == 'part' else None


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """A class of a known part with its fits, the most probable one first."""

    known: KnownPart
    index: int
    seen: Shape
    fits: tuple[tuple[float, ViewFit], ...]
    prior: float

    @property
    def evidence(self) -> float:
        return log_sum([each[0] for each in self.fits])


def identify(
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise | None = None,
    camera: Telecentric | None = None,
) -> Identification:
    """Return which class of which part an observed polygon shows, and where.

    Parameters
    ----------
    seen : Polygon
        Tray frame, m, as `observed_polygon` returns it.
    known : sequence of KnownPart
        At least one; all are equally probable before.
    noise : OutlineNoise, optional
        Errors of the boundary.
    camera : Telecentric or Pinhole, optional
        Of a Pinhole, the hypotheses are what it sees of each part where the polygon is.
    """
    if not known:
        raise InvalidValueError('invalid number of parts 0: expected at least one')
    if isinstance(camera, Pinhole):
        _check_height(camera.position[2], known)
    noise = noise or OutlineNoise()
    found = _identified(seen, known, noise, camera)
    return replace(found, mirrored=_mirrored(found, seen, known, noise, camera))


def _check_height(top: float, known: Sequence[KnownPart]) -> None:
    """Raise InvalidValueError if the camera at a height, m, is not above all outlines."""
    for part in known:
        highest = max(part.outlines, key=lambda outline: outline.height)
        if top <= highest.height:
            raise InvalidValueError(
                f'invalid height {top:.4g} m of the camera: expected more than the height '
                f'{highest.height:.4g} m of {part.part.name} in aspect {highest.aspects[0]}'
            )


def _mirrored(
    found: Identification,
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise,
    camera: Telecentric | None,
) -> tuple[Candidate, ...]:
    """Return `Identification.mirrored`."""
    first = found.candidates[0]
    outlines = {
        (part.part.name, each.symmetry_class): each for part in known for each in part.outlines
    }
    symmetric = outlines[first.part, first.symmetry_class].mirror_symmetric
    if found.answer == 'touching' or (found.answer == 'part' and symmetric):
        return ()
    # The position of the camera is in the same coordinates, and so reversed, too.
    foot = (0.0, camera.position[1] if isinstance(camera, Pinhole) else 0.0)
    other = _identified(affinity.scale(seen, 1.0, -1.0, origin=foot), known, noise, camera)
    own = {(each.part, each.symmetry_class): each.log_likelihood for each in found.candidates}
    return tuple(
        each
        for each in other.candidates
        if other.answer == 'part'
        and each.log_likelihood > first.log_likelihood - AS_WELL
        and each.log_likelihood > own.get((each.part, each.symmetry_class), -np.inf) + AS_WELL
    )


def _identified(
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise,
    camera: Telecentric | None,
) -> Identification:
    """Return the answer without `mirrored`."""
    views = SurfaceViews(seen, noise, camera)
    count = views.at(0.0).perimeter / noise.correlation
    share = (1 - NONE_PRIOR - TOUCHING_PRIOR) / len(known)
    found = []
    for part, k, near in _near(known, views, noise):
        prior = share * max(float(part.shares[k]), MIN_SHARE)
        if isinstance(camera, Pinhole):
            shape = views.at(0.0)
            fits = perspective_fits(part, k, shape, camera, noise, count)
        else:
            shape = near
            fits = class_fits(part.views[k], part.outlines[k].yaw_symmetry, shape, noise, count)
        found.append(_Hypothesis(part, k, shape, fits, prior))
    found.sort(key=lambda each: -each.evidence - np.log(each.prior))
    scores = [each.evidence + np.log(each.prior) for each in found]
    nearest = min((one for each in found for _, one in each.fits), key=lambda one: one.fit.square)
    size = float(np.ptp(shapely.get_coordinates(views.at(0.0).polygon), axis=0).max())
    unknown = unknown_likelihood(nearest.fit, nearest.shape, noise, count, size)
    scores += [unknown + np.log(NONE_PRIOR), unknown + np.log(TOUCHING_PRIOR)]
    # Whether parts touch is found out only where it matters, because it takes longer.
    posterior = np.exp(np.array(scores) - log_sum(scores))
    if posterior[-2:].sum() > 1e-3:
        flat = views.at(found[0].known.outlines[found[0].index].height)
        odds = touching_odds(flat, [s[0] for p in known for s in p.shapes], noise.sd)
        scores[-1] = unknown + np.log(max(TOUCHING_PRIOR * odds, 1e-12))
        posterior = np.exp(np.array(scores) - log_sum(scores))
    candidates = tuple(
        _candidate(each, posterior[k], noise, isinstance(camera, Pinhole))
        for k, each in enumerate(found)
        if k == 0 or posterior[k] > np.exp(-NEGLIGIBLE)
    )
    return Identification(candidates, float(posterior[-2]), float(posterior[-1]), count)


def _near(
    known: Sequence[KnownPart], views: SurfaceViews, noise: OutlineNoise
) -> list[tuple[KnownPart, int, Shape]]:
    """Return the classes that are not far from the observed polygon, and always the nearest.

    See Shape.difference; the parallax may add to it.
    """
    rows = []
    for part in known:
        for k, outline in enumerate(part.outlines):
            seen = views.at(outline.height)
            far = min(shape.difference(seen) for shape in part.shapes[k])
            rows.append((far - views.parallax(outline.height), part, k, seen))
    rows.sort(key=lambda row: row[0])
    return [row[1:] for n, row in enumerate(rows) if n < NEAREST or row[0] < FAR * noise.sd]


def _candidate(
    each: _Hypothesis, posterior: float, noise: OutlineNoise, single: bool
) -> Candidate:
    """Return the candidate; ``single``: each fit has one pose for each aspect of the class."""
    known, k = each.known, each.index
    outline, placement = known.outlines[k], known.placements[k]
    first = each.fits[0][1]
    best = first.fit
    rolls = len(known.views[k].shapes) > 1
    # Those for the first turn of an outline precede the others.
    poses = len(outline.aspects) if single else None
    return Candidate(
        known.part.name,
        outline.symmetry_class,
        outline.aspects,
        best.x,
        best.y,
        best.yaw,
        best.overlap(first.shape.polygon, each.seen.polygon.simplify(noise.sd / 2)),
        best.largest,
        float(np.sqrt(best.square)),
        each.evidence,
        each.prior,
        float(posterior),
        first.roll,
        tuple(
            pose
            for _, one in each.fits
            for pose in placement.poses(
                one.fit.x, one.fit.y, one.fit.yaw, one.orientation if rolls else None
            )[:poses]
        ),
    )
