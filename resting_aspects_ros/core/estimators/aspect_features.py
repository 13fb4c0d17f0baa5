"""Dimensionless features of the aspects of a part, from its landscape.

Lengths are in units of the hull radius R, energies in m g R. The features do not depend on scale,
orientation, or the division of the mesh. In the landscape, the part is a point on the sphere of
down directions, whose potential energy is the support height s. A part that loses its energy
slowly is trapped in one basin after the other:

* *merge shares*: with the energy E, the probability of a set of connected basins is in proportion
  to the integral of (E - s) over them. When E falls below a saddle between two sets, each keeps
  its probability.
* *chain shares*: from its basin, the part passes over a saddle at the rate that transition state
  theory gives for a temperature, or stops, at the rate 1. The *cooled* shares are those after the
  chains of all temperatures, from hot to cold.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.estimators.basin_integrals import BasinIntegrals
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.geometry.polyhedron import Indices, coplanar_facets
from resting_aspects_ros.core.rotations import Array

# Energies, m g R, above the saddle at which two sets of basins part.
EXCESS = (0.0, 0.1, 0.4)
# Temperatures, m g R, of the chain.
TEMPERATURES = (0.03, 0.1, 0.3)
# Nodes of the integrals along the ridges beside a saddle.
RIDGE_NODES = 6
# Smallest share of which a logarithm is taken.
SMALLEST = 1e-6


@dataclass(frozen=True, eq=False)
class AspectFeatures:
    """Features of the aspects of a part.

    Attributes
    ----------
    names : tuple of str
    values : (k, f) float
        Of each aspect, by id.
    of_part : (g,) float
        The same for all aspects: the principal moments of inertia in m R^2, ascending, the height
        of the lowest aspect, and the logarithm of the number of aspects.
    """

    names: tuple[str, ...]
    values: Array
    of_part: Array

    @property
    def moments(self) -> Array:
        """(3,) principal moments of inertia, m R^2."""
        return self.of_part[:3]


def aspect_features(shape: RestingShape) -> AspectFeatures:
    """Return the features of a part with two aspects or more."""
    part, aspects, radius = shape.part, shape.aspects, shape.landscape.radius
    owners = _owners(shape)
    count = len(aspects)
    integrals = BasinIntegrals(shape.landscape, owners, count)
    passes = Passes(shape.landscape, owners, count)
    listed = aspects.aspects
    height = np.array([a.com_height for a in listed]) / radius
    barrier = np.array([a.min_barrier for a in listed]) / radius
    basin = np.array([a.basin_share for a in listed])
    faces = _face_angles(shape, owners) / (4 * np.pi)
    down = np.array([a.down_in_part for a in listed])
    inertia = part.inertia / (part.mass * radius**2)
    upright = np.einsum('ki,ij,kj->k', down, inertia, down)
    level = (np.trace(inertia) - upright) / 2
    edge = (height + barrier) ** 2 - height**2  # square of the lever arm of the lowest edge
    mean_height = integrals.integral(lambda s: s**2 / 2) / integrals.integral(lambda s: s)
    columns = {
        'height': height,
        'barrier': barrier,
        'root of barrier': np.sqrt(barrier),
        'log basin': _log(basin),
        'log face': _log(faces),
        'log facets': _log(_share_of_facets(shape)),
        'log level inertia': np.log(level),
        'log upright inertia': np.log(upright),
        'rocking': (level + height**2 - edge) / (level + height**2 + edge),
        'descent': mean_height - height,
        'root of lever arm': edge**0.25,
    }
    for excess in EXCESS:
        columns[f'merge {excess:g}'] = _log(merge_shares(passes, integrals, excess))
    cooled = basin
    for temperature in TEMPERATURES[::-1]:
        rates = rates_between(passes, integrals, temperature)
        cooled = chain_shares(cooled, rates)
        columns[f'chain {temperature:g}'] = _log(chain_shares(basin, rates))
        columns[f'rate {temperature:g}'] = np.log1p(rates.sum(axis=1))
    columns['cooled'] = _log(cooled)
    columns['neighbour'] = _neighbours(passes, height)
    moments = part.principal_moments / (part.mass * radius**2)
    return AspectFeatures(
        tuple(columns),
        np.column_stack(list(columns.values())),
        np.array([*moments, height.min(), np.log(count)]),
    )


def mean_depth(shape: RestingShape) -> float:
    """Return the mean height of the centre of mass above the lowest point of a turned part, R."""
    integrals = BasinIntegrals(shape.landscape, _owners(shape), len(shape.aspects))
    return float(integrals.integral(lambda s: s**2 / 2).sum() / (4 * np.pi))


class Passes:
    """Saddles between different aspects, lowest first.

    heights : (s,) float
        R.
    between : (s, 2) int
        Indices of the aspects.
    """

    def __init__(self, landscape: Landscape, owners: Indices, aspects: int) -> None:
        saddles, hull = landscape.saddles, landscape.hull
        between = owners[saddles.between]
        used = between[:, 0] != between[:, 1]
        self.count = aspects
        self.between: Indices = between[used]
        self.heights = np.asarray(saddles.heights[used] / landscape.radius)
        ends = hull.points[hull.ends[saddles.edges[used]]]
        self._radii = np.linalg.norm(ends, axis=2)  # (s, 2) of the corners at the ends
        cosines = np.minimum(self.heights[:, None] / self._radii, 1.0)
        self._angles = np.arccos(cosines)  # from the saddle to the corners

    def flows(self, temperature: float) -> Array:
        """Return the integrals (s,) of exp(-s / temperature) along the ridges of each saddle.

        The ridge beside a saddle leads along a great circle to the corners of its edge.
        """
        nodes, weights = np.polynomial.legendre.leggauss(RIDGE_NODES)
        angles = self._angles[..., None] * (1 - (nodes + 1) / 2)
        heights = self._radii[..., None] * np.cos(angles)
        inner = np.exp(-heights / temperature) @ (weights / 2)
        return np.asarray((self._angles * inner).sum(axis=1))


def _owners(shape: RestingShape) -> Indices:
    """Return for each minimum of the landscape the index of its aspect."""
    return np.asarray(shape.aspect_of_facets[shape.landscape.minima])


def _face_angles(shape: RestingShape, owners: Indices) -> Array:
    """Return the solid angles (k,) of the sides on which each aspect rests, sr."""
    hull, found = shape.landscape.hull, np.zeros(len(shape.aspects))
    for index, aspect in enumerate(shape.aspects.aspects):
        face = shape.landscape.minima[owners == index].tolist()
        if not aspect.sweep.curved:
            face = sorted({each for facet in face for each in coplanar_facets(hull, facet)})
        found[index] = shape.facet_angles[face].sum()
    return found


def _share_of_facets(shape: RestingShape) -> Array:
    """Return the share (k,) of the solid angle of the facets that lead to each aspect."""
    weights = shape.facet_angles
    angles = np.bincount(shape.aspect_of_facets, weights=weights, minlength=len(shape.aspects))
    return np.asarray(angles / angles.sum())


def merge_shares(passes: Passes, integrals: BasinIntegrals, excess: float) -> Array:
    """Return the shares (k,) of a part that loses its energy slowly."""
    group = np.arange(passes.count)
    share = np.ones(passes.count)
    for height, (one, other) in zip(passes.heights, passes.between, strict=True):
        first, second = group == group[one], group == group[other]
        if group[one] == group[other]:
            continue
        volume = integrals.integral(_phase_volume(float(height) + excess))
        a, b = (max(volume[each].sum(), 1e-12) for each in (first, second))
        share[first] *= a / (a + b)
        share[second] *= b / (a + b)
        group[second] = group[one]
    return np.asarray(share / share.sum())


def _phase_volume(energy: float) -> Callable[[Array], Array]:
    """Return the antiderivative of max(energy - s, 0)."""
    return lambda s: -(np.maximum(energy - s, 0.0) ** 2) / 2


def rates_between(passes: Passes, integrals: BasinIntegrals, temperature: float) -> Array:
    """Return the rates (k, k) at which a part passes from aspect to aspect."""
    volume = integrals.integral(lambda s: -temperature * np.exp(-s / temperature))
    flows = passes.flows(temperature)
    rates = np.zeros((passes.count, passes.count))
    one, other = passes.between.T
    np.add.at(rates, (one, other), flows)
    np.add.at(rates, (other, one), flows)
    return np.asarray(rates / np.maximum(volume, 1e-300)[:, None])


def chain_shares(start: Array, rates: Array) -> Array:
    """Return where a chain stops that begins with the shares (k,) and stops at the rate 1."""
    total = 1 + rates.sum(axis=1)
    moves = rates / total[:, None]
    visits = np.linalg.solve(np.eye(len(start)) - moves.T, start)
    return np.asarray(visits / total)


def _neighbours(passes: Passes, heights: Array) -> Array:
    """Return the mean height (k,) of the neighbours, relative to that of each aspect, R.

    The mean is weighted with the flow over the saddles.
    """
    flows = passes.flows(TEMPERATURES[-1])
    weights, sums = np.zeros(len(heights)), np.zeros(len(heights))
    for one, other in (passes.between.T, passes.between.T[::-1]):
        np.add.at(weights, one, flows)
        np.add.at(sums, one, flows * heights[other])
    return np.asarray(sums / np.maximum(weights, 1e-300) - heights)


def _log(values: Array) -> Array:
    return np.asarray(np.log(np.maximum(values, SMALLEST)))
