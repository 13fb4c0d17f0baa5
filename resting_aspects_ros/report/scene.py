"""What the 3D view of a page shows: the part's triangles, and how it lies in each row."""

import base64
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import rotate
from resting_aspects_ros.report.posed_part import PosedPart
from resting_aspects_ros.report.rows import Row


def scene(part: Part, rows: Sequence[Row], lying: Sequence[PosedPart]) -> dict[str, object]:
    """Of plain types, for JSON; lengths in hull radii R about the centre of mass.

    Parameters
    ----------
    part : Part
        As it is to be shown.
    rows : sequence of Row
        Those with aspects.
    lying : sequence of PosedPart
        The part in the first aspect of each.

    Returns
    -------
    dict
        ``points`` and ``faces``: little-endian float32 and uint32 in base64. ``rows``:
        ``quaternion`` xyzw, tray from part; ``height`` of the centre of mass; ``colour``;
        ``name``.
    """
    points = (part.vertices - part.centre_of_mass) / part.hull_radius
    return {
        'points': _base64(points.astype('<f4')),
        'faces': _base64(part.faces.astype('<u4')),
        'rows': [
            {
                'name': row.name,
                'colour': row.colour,
                'quaternion': each.orientation.tolist(),
                # Not the aspect's, which smooths a curved side: the mesh is to touch the tray.
                'height': -_lowest(part, each) / part.hull_radius,
            }
            for row, each in zip(rows, lying, strict=True)
        ],
    }


def _lowest(part: Part, lying: PosedPart) -> float:
    """Height of the lowest point above the centre of mass, m."""
    return float(rotate(lying.orientation, part.vertices - part.centre_of_mass)[:, 2].min())


def _base64(array: npt.NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode('ascii')
