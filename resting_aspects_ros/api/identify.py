"""Tell from an observed outline which part lies where and how, and locate parts."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, located, shown, warn
from resting_aspects_ros.input_files import file_text, parse_json, read_input
from resting_aspects_ros.part.hull import smallest_rectangle
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.vision.camera import Telecentric
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import (
    Identification,
    Polygonal,
    identify,
    observed_polygon,
)
from resting_aspects_ros.vision.location import Pose
from resting_aspects_ros.vision.outline import find_outlines
from resting_aspects_ros.vision.rolling import KnownPart

# Added to each count of a distribution, so that an aspect that was never seen remains possible.
PSEUDO_COUNT = 0.5

Shares = Distribution | DropResult | Mapping[int, float] | npt.ArrayLike

# Maximum size of a file with an outline.
MAX_BYTES = 1 << 24


def known_part(part: Part | str | Path, shares: Shares | None = None) -> KnownPart:
    """Prepare a part for `identify_part` and `locate_part`, so that each call takes milliseconds.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    shares : Distribution, DropResult, mapping or (k,) array, optional
        How often the part lies in each aspect: drops, a mapping from aspect ids to shares (aspects
        that it does not contain have the share 0), or the shares of all aspects by id, such as
        ``result.long_run.shares`` of `reorient`. By default the part is dropped 1000 times on
        rubber_mat.

    Raises
    ------
    InvalidValueError
        The shares are negative, all zero, or of other aspects; or the part has no aspect.
    PartError
        An outline has several pieces or no area.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> known = ra.known_part('l_bracket', {1: 0.5, 3: 0.5})
    >>> known.shares.tolist()
    [0.5, 0.0, 0.5, 0.0, 0.0]
    """
    loaded = given_part(part)
    aspects = find_aspects(loaded)
    if not len(aspects):
        raise InvalidValueError(f'invalid part {loaded.name}: expected a part with an aspect')
    if shares is None:
        shares = drop(loaded, keep_poses=False, model_range=False)
    by_aspect = _given(shares, aspects)
    outlines = find_outlines(loaded, aspects)
    by_class = np.array(
        [sum(by_aspect[number - 1] for number in each.aspects) for each in outlines]
    )
    found = KnownPart(loaded, aspects, outlines, by_class / by_class.sum())
    _ = found.views, [each.members for each in found.placements]  # computed once, now
    return found


def identify_part(
    polygon: Polygonal,
    parts: KnownPart | Part | str | Path | Iterable[KnownPart | Part | str | Path],
    *,
    noise: OutlineNoise | None = None,
    camera: Telecentric | None = None,
) -> Identification:
    """Return which aspects of which parts an observed polygon may show, with poses.

    Parameters
    ----------
    polygon : shapely.Polygon, (n, 2) array, or mapping with 'outer' and 'holes'
        Tray frame, m; seen from above, x right and y up. See `observed_polygon`.
    parts : KnownPart, Part, str or Path, or several
        Candidates, equally probable before. Others than a KnownPart are prepared at each call,
        which takes most of the time. Of equal parts, the first is used.
    noise : OutlineNoise, optional
        Errors of the boundary, by default 0.1 mm (standard deviation), independent after 1 mm.
    camera : Telecentric or Pinhole, optional
        With a Pinhole, the candidates are what it sees of the parts where the polygon is; the
        polygon is as seen on the surface.

    Returns
    -------
    Identification
        Candidates by posterior, and the probabilities of 'none of these' and 'touching parts'.

    Raises
    ------
    InvalidValueError
        The polygon is not valid, or there is no part.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> found = ra.identify_part([[0, 0], [0.04, 0], [0.04, 0.02], [0, 0.02]], 'l_bracket')
    >>> found.answer, found.best.aspects
    ('part', (3,))
    """
    seen = observed_polygon(polygon)
    if not isinstance(noise, OutlineNoise | None):
        raise InvalidValueError(f'invalid noise {shown(noise)}: expected an OutlineNoise')
    if not isinstance(camera, Telecentric | None):
        raise InvalidValueError(
            f'invalid camera {shown(camera)}: expected a Pinhole or Telecentric camera'
        )
    if isinstance(parts, KnownPart | Part | str | Path):
        parts = [parts]
    known: dict[str, KnownPart] = {}
    for each in parts:
        one = each if isinstance(each, KnownPart) else known_part(each)
        first = known.setdefault(one.part.part_sha256, one)
        if first is not one:
            warn(f'{one.part.name} is the same part as {first.part.name}: it is left out')
    return identify(seen, list(known.values()), noise, camera)


def locate_part(
    part: KnownPart | Part | str | Path, aspect: int, x: float, y: float, yaw: float
) -> tuple[Pose, ...]:
    """Return the poses of a part that a camera sees in an aspect at (x, y, yaw).

    Parameters
    ----------
    part : KnownPart, Part, str or Path
        Others than a KnownPart are prepared at each call, which takes most of the time.
    aspect : int
        Id of the aspect.
    x, y : float
        Projection of the centre of mass, tray frame, m.
    yaw : float
        Yaw of the outline of the class, rad, counter-clockwise seen from above.

    Returns
    -------
    tuple of Pose
        Tray frame; first those in the aspect. The others look the same: other aspects of the
        symmetry class, and rotations of the outline onto itself that no rotation of the part
        causes.

    Raises
    ------
    InvalidValueError
        The part has no such aspect, or a value is not a finite number.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> poses = ra.locate_part('l_bracket', 1, 0.1, 0.05, 0.0)
    >>> [pose.aspect for pose in poses], [pose.yaw_known for pose in poses]
    ([1], [True])
    """
    # The poses do not depend on the shares, so that the part need not be dropped for them.
    known = part if isinstance(part, KnownPart) else known_part(part, {1: 1.0})
    for placement in known.placements:
        if not isinstance(aspect, bool) and aspect in placement.outline.aspects:
            poses = placement.poses(x, y, yaw)
            return tuple(sorted(poses, key=lambda pose: pose.aspect != aspect))
    raise InvalidValueError(
        f'invalid aspect {shown(aspect)} of {known.part.name}: expected 1 to {len(known.aspects)}'
    )


def identification_document(found: Identification) -> dict[str, Any]:
    """Return an identification as a document of plain JSON types: m, rad, quaternions xyzw."""
    return {
        'schema_version': SCHEMA_VERSION,
        'answer': found.answer,
        'none': found.none,
        'touching': found.touching,
        'effective_samples': found.effective_samples,
        'mirrored': [
            {name: plain(getattr(each, name)) for name in ('part', 'symmetry_class', 'aspects')}
            for each in found.mirrored
        ],
        'candidates': [plain(dataclasses.asdict(each)) for each in found.candidates],
    }


def _given(shares: Shares, aspects: AspectSet) -> npt.NDArray[np.float64]:
    """Return the given shares (k,) of the aspects; raises InvalidValueError."""
    if isinstance(shares, DropResult):
        shares = shares.distribution
    if isinstance(shares, Distribution):
        if not aspects.matches(shares.aspects):
            raise InvalidValueError(
                'invalid shares: expected the distribution of the same part, with the same aspects'
            )
        return np.asarray(shares.counts + PSEUDO_COUNT)
    count = len(aspects)
    if isinstance(shares, Mapping):
        for number in shares:
            if isinstance(number, bool) or number not in range(1, count + 1):
                raise InvalidValueError(
                    f'invalid aspect {shown(number)} of the shares: expected 1 to {count}'
                )
        shares = [shares.get(number, 0.0) for number in range(1, count + 1)]
    try:
        found = np.asarray(shares, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (count,) or not (
        np.isfinite(found).all() and found.min() >= 0 < found.sum()
    ):
        raise InvalidValueError(
            f'invalid shares {shown(shares)}: expected {count} numbers of 0 or more, one for each '
            'aspect, with a sum above 0'
        )
    return found


def identification_hint(
    found: Identification, seen: shapely.Polygon, known: Sequence[KnownPart]
) -> str:
    """Return why an observed polygon may show no known part, or another one; can be empty."""
    hint = mirror_text(found)
    if found.answer != 'none':
        return hint
    length = np.linalg.norm(smallest_rectangle(shapely.get_coordinates(seen))[1][0])
    longest = max(outline.length for part in known for outline in part.outlines)
    text = (
        f'It is {1000 * length:.3g} mm long, and the longest known outline {1000 * longest:.3g} '
        'mm. If it is a known part, check the unit (m), the scale of the camera, the unit of the '
        'mesh (--unit), the noise, and that "holes" contains the through-holes.'
    )
    return f'{text} {hint}'.strip()


def mirror_text(found: Identification) -> str:
    """Return which aspects the mirror image of an outline shows; can be empty."""
    if not found.mirrored:
        return ''
    names = '; '.join(
        f'{each.part}, aspect{"s" * (len(each.aspects) > 1)} {", ".join(map(str, each.aspects))}'
        for each in found.mirrored
    )
    return (
        f'The mirror image of the outline fits {names}: if y points down in its coordinates, as '
        'in an image, reverse the sign of y.'
    )


def read_polygon(path: Path) -> shapely.Polygon:
    """Return the polygon of a document with outer and holes; raises InvalidValueError."""
    document = parse_json(path, read_input(path, MAX_BYTES, 'polygon'))
    if 'outlines' in document and 'outer' not in document:
        raise InvalidValueError(
            f'invalid --polygon {file_text(path)}: expected one outline with outer and holes; '
            'this is the document of resting_aspects outlines, whose list outlines has one for '
            'each class'
        )
    with located(file_text(path)):
        return observed_polygon(document)
