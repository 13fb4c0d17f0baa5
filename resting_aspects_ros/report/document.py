"""A distribution as a JSON document: the fields of the message AspectDistribution, SI units."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects import Aspect
from resting_aspects_ros.core.distribution import CONFIDENCE, INTERVAL, Distribution, Interval

SCHEMA_VERSION = 1

# Fields of the message Aspect that this version does not know yet; zero and false, as there.
NOT_KNOWN: dict[str, object] = {
    'symmetry_class': 0,
    'multiplicity': 0,
    'rolls': False,
    'least_barrier': 0.0,
    'basin_share': 0.0,
}


def distribution_document(
    distribution: Distribution, run: Mapping[str, object]
) -> dict[str, object]:
    """All that is known of a distribution, of plain types that JSON has. Nothing is rounded.

    Parameters
    ----------
    distribution : Distribution
    run : mapping
        What the drops were: part, hashes, method, seed, conditions, engine, ... in SI units.
        Arrays become lists, dataclasses objects, an enumeration's member its name, and a number
        that JSON does not have (nan, infinite) null. What this document counts itself, such as
        ``drops``, replaces a field of the same name.

    Returns
    -------
    dict
        ``schema_version``, the fields of ``run``, the counts of drops, what the intervals are,
        and ``aspects`` by id with the fields of the message Aspect: ``com_height`` m,
        ``support`` m on the surface below the centre of mass, ``orientation`` xyzw, tray from
        part, ``down_in_part`` a unit vector, part frame.
    """
    rows = zip(
        distribution.aspects.aspects, distribution.counts, distribution.intervals(), strict=True
    )
    own: dict[str, object] = {
        'drops': distribution.drops,
        'unclassified': int(distribution.unclassified),
        'unsettled': int(distribution.unsettled),
        'failed': int(distribution.failed),
        'confidence': CONFIDENCE,
        'interval': INTERVAL,
        'aspects': [_aspect(aspect, int(count), interval) for aspect, count, interval in rows],
    }
    given = {str(name): _plain(value) for name, value in run.items() if name not in own}
    return {'schema_version': SCHEMA_VERSION} | given | own


def to_json(document: Mapping[str, object]) -> str:
    """As text that ends in a newline; ValueError if a number in it is not finite."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def _aspect(aspect: Aspect, count: int, interval: Interval) -> dict[str, object]:
    return {
        'id': aspect.id,
        'down_in_part': _numbers(aspect.down_in_part),
        'com_height': float(aspect.com_height),
        'orientation': _numbers(aspect.orientation),
        'support': _numbers(aspect.support),
        'count': count,
        'probability': interval.probability,
        'lower': interval.lower,
        'upper': interval.upper,
        **NOT_KNOWN,
    }


def _numbers(array: npt.NDArray[np.float64]) -> list[Any]:
    # Adding zero changes no number but -0.0, which would be read as a direction.
    values: list[Any] = (np.asarray(array, dtype=np.float64) + 0.0).tolist()
    return values


def _plain(value: object) -> object:
    """The same value of types that JSON has."""
    if isinstance(value, Enum):
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
