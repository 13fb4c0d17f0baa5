"""Compares the aspects of random parts with an independent landscape.

Each part is of a random family, rotated, and between 1e-6 m and 10 m large.
"""

import traceback
from collections.abc import Iterable, Iterator

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from fuzz.part_families import CERTAIN, FAMILIES, NOISE, Array, Landscape, Shape
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part

# Errors of heights, as a share of the radius: facets are merged within 1e-5.
TOLERANCE = 3e-5
# A triangle is a rest of an aspect if its normal is within this angle of a direction of it, rad.
SAME_REST = 2e-3


def random_part(shape: Shape, generator: np.random.Generator) -> tuple[Part, Landscape]:
    """Return a shape as a part, rotated and scaled, and its landscape, in its own unit."""
    turn = Rotation.random(random_state=int(generator.integers(1 << 31))).as_matrix()
    points = shape.points @ turn.T
    size = np.ptp(points, axis=0).max()
    metres = 10 ** generator.uniform(-6, 1)
    mesh = trimesh.convex.convex_hull(points)
    mesh.apply_scale(metres / size)
    data = mesh.export(file_type='ply', vertex_normal=False)
    return part_from_bytes(data, 'ply', 'part', unit='m'), Landscape(mesh.vertices)


def differences(shape: Shape, part: Part, truth: Landscape) -> Iterator[str]:
    """Yield how the aspects of a part differ from the truth."""
    aspects = find_aspects(part)
    tolerance = TOLERANCE * truth.radius + part.hull_error
    scale = truth.radius / Landscape(shape.points).radius
    by_mesh = CERTAIN * shape.depth * scale + tolerance
    if shape.aspects is not None and len(aspects) != shape.aspects:
        yield f'{len(aspects)} aspects instead of {shape.aspects}'
    if abs(sum(a.basin_share for a in aspects) - 1) > 1e-3:
        yield 'the basins do not add up to 1'
    for a in aspects:
        heights = truth.height(a.directions[: a.level])
        below = by_mesh + NOISE * a.com_height if a.sweep.curved else tolerance
        checked = heights if a.sweep.curved else heights[:1]
        if checked.min() < a.com_height - below or checked.max() > a.com_height + tolerance:
            found = f'{checked.min():g} to {checked.max():g} m instead of {a.com_height:g} m'
            yield f'aspect {a.id} is at {found}'
        if a.merged > by_mesh + NOISE * truth.radius:
            yield f'aspect {a.id} ignores a barrier of {a.merged / truth.radius:.2g} R'
    yield from _barriers(aspects, truth, tolerance)
    # Corners of a simplified hull are missing, so that its minima are beside the true ones.
    yield from _minima(aspects, truth, tolerance, limit=0.15 if part.hull_error > 0 else 0.02)


def _owners(aspects: AspectSet, truth: Landscape) -> Array:
    """Return the index (f,) of the aspect that each triangle is a rest of, or -1."""
    group = np.full(len(truth.heights), -1)
    for k, a in enumerate(aspects):
        nearest = (truth.normals @ a.directions.T).max(axis=1)
        group[nearest > np.cos(SAME_REST)] = k
    return group


def _barriers(aspects: AspectSet, truth: Landscape, tolerance: float) -> Iterator[str]:
    """Yield aspects whose barrier is not that of the lowest pass to another aspect."""
    if len(aspects) < 2:
        return
    passes = truth.lowest_passes(_owners(aspects, truth))
    for a, top in zip(aspects, passes, strict=True):
        highest = truth.height(a.directions[: a.level]).max()
        # A pass to an ignored minimum leads back.
        if abs(top - highest - a.min_barrier) > tolerance + a.merged:
            yield f'barrier of aspect {a.id}: {a.min_barrier:g} instead of {top - highest:g} m'


def _minima(aspects: AspectSet, truth: Landscape, tolerance: float, limit: float) -> Iterator[str]:
    """Yield minima that are in no aspect, although their barrier is above all that is ignored."""
    ignored = max((a.merged for a in aspects), default=0.0)
    directions = np.concatenate([a.directions for a in aspects])
    for k, barrier in truth.minima():
        normal = truth.normals[k]
        if barrier > ignored + tolerance and (directions @ normal).max() < np.cos(limit):
            yield f'no aspect for the minimum {normal.round(3)}, barrier {barrier:g} m'


def findings(numbers: Iterable[int], seed: int) -> Iterator[str]:
    """Yield what is wrong with random parts; seed and number determine a part."""
    for number in numbers:
        generator = np.random.default_rng([seed, number])
        shape = FAMILIES[number % len(FAMILIES)](generator)
        try:
            part, truth = random_part(shape, generator)
            wrong = list(differences(shape, part, truth))
        except Exception:  # noqa: BLE001 any error is a finding
            wrong = [traceback.format_exc(limit=-2)]
        for each in wrong:
            yield f'{number} {shape.name}: {each}'
