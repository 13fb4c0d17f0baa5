"""JSON documents of distributions and aspects: fields of the ROS messages, in SI units."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.aspects.aspect_set import PUBLISHED_FIELDS, Aspect, AspectSet
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

SCHEMA_VERSION = 2


def distribution_document(
    distribution: Distribution, run: Mapping[str, object], part: Part | None = None
) -> dict[str, object]:
    """Return a distribution as a document of plain JSON types. Nothing is rounded.

    Fields that the distribution defines, such as ``drops``, replace those of ``run``, the
    description of the run. The part is needed for ``rests_on``. docs/reference/files.md describes
    the keys; the aspects have the fields of the message Aspect.
    """
    classes = distribution.by_class()
    rows = zip(distribution.aspects, _shares(distribution), strict=True)
    class_rows = zip(distribution.aspects.classes(), _shares(classes), strict=True)
    own: dict[str, object] = {
        'drops': distribution.drops,
        'unclassified': int(distribution.unclassified),
        'unsettled': int(distribution.unsettled),
        'failed': int(distribution.failed),
        'lost': int(distribution.lost),
        'sliding': int(distribution.sliding),
        'energy_growth': distribution.energy_growth,
        'aspect_numbering': ASPECT_NUMBERING,
        'confidence': distribution.confidence,
        'interval': distribution.interval,
        'model_uncertain': None if distribution.model is None else distribution.model.uncertain,
        'aspects': [aspect_fields(aspect, part) | share for aspect, share in rows],
        'classes': [
            {
                'symmetry_class': members[0].symmetry_class,
                'multiplicity': len(members),
                'aspects': [aspect.id for aspect in members],
                **share,
            }
            for members, share in class_rows
        ],
    }
    from_run = {str(name): plain(value) for name, value in run.items() if name not in own}
    return {'schema_version': SCHEMA_VERSION} | from_run | own


def aspects_document(part: Part, aspects: AspectSet) -> dict[str, object]:
    """Return what follows from a part's shape alone: its symmetry, and its aspects by id."""
    document: dict[str, object] = {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'hull_radius': part.hull_radius,
        'hull_error': part.hull_error,
    }
    if aspects.symmetry is not None:
        axis = aspects.symmetry.axis
        document['symmetry'] = aspects.symmetry.kind
        document['symmetry_order'] = aspects.symmetry.order
        document['symmetry_axis'] = None if axis is None else numbers(axis)
    document['aspects'] = [aspect_fields(aspect, part) for aspect in aspects]
    return document


def to_json(document: Mapping[str, object]) -> str:
    """Return the document as text with a final newline; ValueError if a number is not finite."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def aspect_fields(aspect: Aspect, part: Part | None) -> dict[str, object]:
    """Return the fields of the message Aspect that need no drops, and the text ``rests_on``."""
    fields = {name: plain(getattr(aspect, name)) for name in PUBLISHED_FIELDS}
    first = {name: fields[name] for name in ('id', 'symmetry_class', 'multiplicity')}
    return {**first, 'rests_on': resting_on(part, aspect), **fields}


def share_fields(count: int, interval: Interval) -> dict[str, object]:
    """Return a count, its share of the drops, and the interval of the share."""
    return {
        'count': count,
        'probability': interval.probability,
        'lower': interval.lower,
        'upper': interval.upper,
    }


def _shares(distribution: Distribution) -> list[dict[str, object]]:
    rows = zip(
        distribution.counts.tolist(),
        distribution.intervals(),
        distribution.model_intervals(),
        strict=True,
    )
    return [
        share_fields(count, interval)
        | {'model_lower': model and model.lower, 'model_upper': model and model.upper}
        for count, interval, model in rows
    ]


def numbers(array: npt.NDArray[np.float64]) -> list[Any]:
    """Return the array as nested lists."""
    # Adding 0.0 only changes -0.0, whose sign would look like a direction.
    values: list[Any] = (np.asarray(array, dtype=np.float64) + 0.0).tolist()
    return values


def plain(value: object) -> object:
    """Return the value converted to types that JSON has."""
    if isinstance(value, Enum):
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
