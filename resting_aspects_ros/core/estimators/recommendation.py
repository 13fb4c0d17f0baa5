"""Recommendation of a method for a part and the conditions of its drops.

It is based on the measurements in docs/explanation/estimators.md.
"""

from dataclasses import dataclass

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.estimators.learned import shipped_model
from resting_aspects_ros.core.estimators.release import Release

# Release heights, hull radii, between which csa deviates least from drops. The limits are halfway,
# on a logarithmic scale, between heights at which this was measured and heights at which not.
_LOW, _HIGH = 0.2, 20.0
# Share of directions that lead to a curved side, such as the rim of a washer, up to which csa is
# valid.
_MAX_CURVED_SHARE = 0.15

# Root mean square deviation of learned from drops of kinds of solids that were not fitted,
# percentage points, for parts without and with a curved side.
FLAT_DEVIATION, CURVED_DEVIATION = 3.0, 7.0


@dataclass(frozen=True)
class Recommendation:
    """The method that deviates least from drops, and the reason in a sentence.

    method : str
        One of METHODS; empty if no method is recommended.
    """

    method: str
    reason: str


def recommend(aspects: AspectSet, release: Release, *, thrown: bool) -> Recommendation:
    """Return the recommended method for a part.

    Parameters
    ----------
    aspects : AspectSet
        Aspects of the part.
    release : Release
        The conditions of its drops.
    thrown : bool
        Whether the part is released with a significant speed or spin.
    """
    if len(aspects) == 1:
        return Recommendation('', 'The part has one aspect: its probability is 100 %.')
    curved = sum(a.basin_share for a in aspects.aspects if a.sweep.curved)
    outside = shipped_model().bounds.outside(release)
    if not outside:
        return _learned(curved)
    found = _analytic(curved, release.height, thrown=thrown)
    limit = f'The {outside} is beyond the conditions to which learned is fitted. '
    return Recommendation(found.method, limit + found.reason)


def _learned(curved: float) -> Recommendation:
    if curved > _MAX_CURVED_SHARE:
        return Recommendation(
            'learned',
            f'The recommended method is learned, but from {100 * curved:.0f} % of all directions '
            f'the part rolls onto a curved side, and for such parts it deviates from drops by '
            f'about {CURVED_DEVIATION:g} points (root mean square): simulate drops.',
        )
    return Recommendation(
        'learned',
        'The recommended method is learned: it knows the conditions, and deviates from drops by '
        f'about {FLAT_DEVIATION:g} points (root mean square) for kinds of parts that were not '
        'fitted.',
    )


def _analytic(curved: float, height: float, *, thrown: bool) -> Recommendation:
    if curved > _MAX_CURVED_SHARE:
        return Recommendation(
            '',
            f'No method is recommended: from {100 * curved:.0f} % of all orientations the part '
            'rolls onto a curved side, and for such parts all methods deviate from drops by 5 '
            'points or more.',
        )
    if height < _LOW and not thrown:
        return Recommendation(
            'rolling',
            f'The recommended method is rolling: for release heights below {_LOW:g} part radii '
            f'(here {height:.2g}), it has the smallest deviation from drops, about 1 point.',
        )
    csa = 'The recommended method is the centroid solid angle (csa): '
    if curved:
        return Recommendation(
            'csa',
            f'{csa}it has the smallest deviation from drops for parts that rarely rest on their '
            'curved side.',
        )
    if height <= _HIGH and not thrown:
        return Recommendation(
            'csa',
            f'{csa}for release heights from {_LOW:g} to {_HIGH:g} part radii (here {height:.2g}), '
            'it has the smallest deviation from drops, about 1 point.',
        )
    high = f'release heights above {_HIGH:g} part radii (here {height:.2g})'
    return Recommendation(
        'crsa',
        'The recommended method is the critical solid angle (crsa): for '
        f'{"thrown parts" if thrown else high}, it has the smallest deviation from drops, 1 to 2 '
        'points.',
    )
