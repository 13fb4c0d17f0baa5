"""The data of the 3D view of a page: the triangles of the part, and its pose in each row."""

import base64
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import Row
from resting_aspects_ros.report.picture import PosedPart
from resting_aspects_ros.rotations import rotate


def scene(part: Part, rows: Sequence[Row], posed_parts: Sequence[PosedPart]) -> dict[str, object]:
    """Return the data of the view as plain types for JSON; lengths are in hull radii.

    Parameters
    ----------
    part : Part
        The part, simplified if it has too many triangles.
    rows : sequence of Row
        The rows with aspects.
    posed_parts : sequence of PosedPart
        The part in the first aspect of each row.

    Returns
    -------
    dict
        ``points``, relative to the centre of mass, and ``faces``: little-endian float32 and uint32
        in base64. ``rows``:
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
                # Computed from the mesh, which must touch the tray: the height of the aspect is
                # that of a smooth curved side.
                'height': -_lowest(part, each) / part.hull_radius,
            }
            for row, each in zip(rows, posed_parts, strict=True)
        ],
    }


def _lowest(part: Part, posed: PosedPart) -> float:
    """Return the height of the lowest point relative to the centre of mass, m."""
    return float(rotate(posed.orientation, part.vertices - part.centre_of_mass)[:, 2].min())


def _base64(array: npt.NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode('ascii')
