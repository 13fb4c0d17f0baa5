"""JSON documents of outlines: what a camera sees of each symmetry class, in SI units."""

from collections.abc import Mapping, Sequence

import numpy as np
from shapely import Polygon

from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers
from resting_aspects_ros.vision.outline import LookAlike, Outline

LookAlikes = Mapping[int, Sequence[LookAlike]]


def outlines_document(
    part: Part, outlines: Sequence[Outline], look_alikes: LookAlikes
) -> dict[str, object]:
    """Return the outlines of a part as a document of plain JSON types. Nothing is rounded.

    Parameters
    ----------
    part : Part
    outlines : sequence of Outline
    look_alikes : mapping of int to sequence of LookAlike
        By symmetry class, from `core.vision.matching.look_alikes`.

    Returns
    -------
    dict
        ``schema_version``, name and hashes of the part, and ``outlines`` by symmetry class:
        lengths in m, areas in m2, angles in rad, coordinates in the axes of the tray with the
        origin below the centre of mass.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'outlines': [_fields(each, look_alikes[each.symmetry_class]) for each in outlines],
    }


def _fields(outline: Outline, others: Sequence[LookAlike]) -> dict[str, object]:
    return {
        'aspects': list(outline.aspects),
        'symmetry_class': outline.symmetry_class,
        **polygon_fields(outline.polygon),
        'area': outline.area,
        'length': outline.length,
        'width': outline.width,
        'height': outline.height,
        'com_height': outline.com_height,
        'centroid': numbers(outline.centroid),
        'long_axis': outline.long_axis,
        'orientation': numbers(outline.orientation),
        'yaw_symmetry': outline.yaw_symmetry,
        'mirrored': [each.symmetry_class for each in others if each.verdict == 'mirrored'],
        'mirror_symmetric': bool(outline.mirror_symmetric),
        'family': [polygon_fields(each) for each in outline.family],
        'look_alike': [
            {
                'symmetry_class': each.symmetry_class,
                'overlap': each.overlap,
                'verdict': each.verdict,
                'resolution': each.resolution,
            }
            for each in others
        ],
    }


def polygon_fields(polygon: Polygon) -> dict[str, object]:
    """Return ``outer`` and ``holes`` of a polygon: corners [x, y], the first one not repeated."""
    return {
        'outer': numbers(np.asarray(polygon.exterior.coords)[:-1]),
        'holes': [numbers(np.asarray(hole.coords)[:-1]) for hole in polygon.interiors],
    }
