"""Validation of surroundings: mechanics against formulas, symmetry, and the time step."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import trimesh
from dropper import SEED, Dropper
from paired_actions import Counts, class_indices, shifts
from rich.progress import track
from scipy.stats import chi2_contingency
from surroundings_mechanics import mechanics, solid
from surroundings_symmetry import CHIRAL, counts_on_belt, mirrored_chute, tilted_plane

import resting_aspects_ros as ra
from resting_aspects_ros.api.surroundings import aspects_in, with_surroundings
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.distribution import aspect_ids, count_poses
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.plan import make_job

# About 20 minutes of two processes on idle cores, of which the time step takes nearly all.
SYMMETRY_DROPS = 4000
STEP_DROPS = 4000
STEP_PARTS = ('l_bracket', 'hex_nut', 'box_10x20x30', 't_prism')
STEP_SURROUNDINGS = ('slope', 'v_groove', 'l_chute')

OUTSIDE = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
_OUTCOME = (RestStatus.UNSETTLED, RestStatus.FAILED, RestStatus.LOST, RestStatus.SLIDING)


def surroundings(dropper: Dropper) -> Iterator[str]:
    """Compare surroundings with formulas, with each other, and with half the time step."""
    inelastic = dropper.surfaces.get().changed(restitution=0.0, rolling_friction=0.0)
    yield '## Surroundings against formulas'
    yield ''
    yield (
        'Bodies that are placed on slopes, in grooves and on belts, without restitution and '
        'rolling friction, at the default time step unless it is stated. *n*: bodies. *Stays*: '
        'creeps less than 0.001 R in 10 T. For a threshold, *found* is the range of tested angles '
        'within which the behaviour of all bodies changes; angles 0.1, 0.2, 0.3 and 0.5 degrees '
        'below and above the formula were tested, and the aim is 0.3.'
    )
    yield ''
    yield '| what | n | formula | found |'
    yield '|---|---|---|---|'
    for name, n, formula, found in mechanics(inelastic):
        yield f'| {name} | {n} | {formula} | {found} |'
    yield ''
    yield from _symmetry(dropper)
    yield from _time_step(dropper)


def _symmetry(dropper: Dropper) -> Iterator[str]:
    yield '## Surroundings that must have the same distribution'
    yield ''
    n = SYMMETRY_DROPS
    yield (
        f'{n} drops in each of two surroundings. *Largest*: largest difference of the share of an '
        'aspect. *p*: probability that chance alone causes a difference at least as large '
        '(chi-square). A level slope must have the poses of the plane, bit for bit.'
    )
    yield ''
    yield '| what | n | largest | p |'
    yield '|---|---|---|---|'
    part = next(p for p in dropper.parts if p.name == 'l_bracket')
    level = make_job(part, dropper.surfaces.get(), SEED)
    aspects = find_aspects(part)
    still = dataclasses.replace(level, until_still=True)
    pair = [
        np.sum([count_poses(aspects, poses).counts for poses in dropper.poses(job, n)], axis=0)
        for job in (tilted_plane(level, 0.5), still)
    ]
    yield f'| l_bracket, plane and gravity tilted by 0.5 rad | {_difference(*pair)} |'
    yield from _mirror(dropper, n)
    conditions = with_surroundings(dropper.surfaces.get(), ra.surroundings('slope', angle=0.0))
    job = make_job(part, conditions, SEED)
    same = [
        np.array_equal(a.position, b.position) and np.array_equal(a.orientation, b.orientation)
        for a, b in zip(dropper.poses(job, n), dropper.poses(level, n), strict=True)
    ]
    words = 'the same, bit for bit' if all(same) else 'different'
    yield f'| l_bracket, a slope of 0 degrees and the plane | {n} | {words} | |'
    yield ''


def _mirror(dropper: Dropper, n: int) -> Iterator[str]:
    shape = solid(trimesh.convex.convex_hull(CHIRAL))
    other = solid(trimesh.convex.convex_hull(CHIRAL * [1, -1, 1]))
    conditions = with_surroundings(dropper.surfaces.get(), ra.surroundings('chute'))
    aspects = find_aspects(shape)
    job, image = (make_job(part, conditions, SEED) for part in (shape, other))
    counts = [
        np.sum([counts_on_belt(j, aspects, p, flip) for p in dropper.poses(j, n)], axis=0)
        for j, flip in ((job, 1), (mirrored_chute(image), -1))
    ]
    yield f'| chiral tetrahedron, chute and mirrored chute | {_difference(*counts)} |'


def _difference(one: npt.NDArray[np.int64], other: npt.NDArray[np.int64]) -> str:
    table = np.array([one, other])
    found = chi2_contingency(table[:, table.sum(axis=0) > 0])
    largest = np.abs(one / one.sum() - other / other.sum()).max()
    return f'{one.sum()} | {largest:.4f} | {found.pvalue:.2f}'


def _time_step(dropper: Dropper) -> Iterator[str]:
    yield '## Surroundings and the time step'
    yield ''
    yield (
        f'{STEP_DROPS} drops on `rubber_mat` with the time step of the suite and again with half '
        'of it, from the same states. *Differ*: share of the drops that end in another symmetry '
        'class of aspects, or otherwise. *Shift*: of the share that changes most (a class, or '
        f'{", ".join(OUTSIDE)}), with its standard error, which follows from the drops that end '
        'differently. *Bound*: no share changes by more than this, with a confidence of 95 %. '
        'The aim is 0.01; where the bound is larger and the shift is below 2 standard errors, '
        'the number of drops does not suffice to show it.'
    )
    yield ''
    yield '| part | surroundings | drops | differ | share | shift | error | bound |'
    yield '|---|---|---|---|---|---|---|---|'
    parts = {part.name: part for part in dropper.parts}
    cases = [(parts[p], name) for name in STEP_SURROUNDINGS for p in STEP_PARTS]
    for part, name in track(cases, 'surroundings'):
        counts = _joint_counts(dropper, part, name)
        found = shifts(counts)
        _, column = found.largest
        classes = counts.shape[1] - len(OUTSIDE)
        share = f'class {column + 1}' if column < classes else OUTSIDE[column - classes]
        yield (
            f'| {part.name} | {name} | {counts.sum()} | {found.different:.3f} | {share} '
            f'| {found.shift[0, column]:+.4f} | {found.error[0, column]:.4f} '
            f'| {found.bound:.4f} |'
        )
    yield ''


def _joint_counts(dropper: Dropper, part: Part, name: str) -> Counts:
    """Return counts (1, m, m) by the ends with coarse and with fine steps."""
    job = make_job(part, with_surroundings(dropper.surfaces.get(), ra.surroundings(name)), SEED)
    aspects = aspects_in(job.scene, find_aspects(part))
    ends = [
        _ends(dropper, each, aspects) for each in (job, dataclasses.replace(job, refinement=2))
    ]
    size = len(aspects.classes()) + len(OUTSIDE)
    counts = np.zeros((1, size, size), dtype=np.int64)
    np.add.at(counts[0], tuple(ends), 1)
    return counts


def _ends(dropper: Dropper, job: DropJob, aspects: AspectSet) -> Counts:
    poses = RestingPoses.join(list(dropper.poses(job, STEP_DROPS)))
    classes = len(aspects.classes())
    known = np.append(classes, class_indices(aspects))  # the id 0 is unclassified
    ends = known[aspect_ids(aspects, poses)]
    for k, status in enumerate(_OUTCOME, start=classes + 1):
        ends[poses.status == status] = k
    return np.asarray(ends)
