"""Validation of surroundings: the same drops with refined numerical parameters."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from rich.progress import track
from scipy.stats import chi2

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import aspects_in, with_surroundings
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.job import KERNEL, make_job
from validation.dropper import SEED, Dropper
from validation.paired import (
    OUTSIDE,
    REFINEMENT,
    Counts,
    Shifts,
    class_indices,
    homogeneity,
    paired_counts,
    shifts,
)

# About 10 minutes of processor time.
DROPS = 20_000
PARTS = ('l_bracket', 'box_10x20x30', 't_prism')
SURROUNDINGS = ('slope', 'v_groove', 'l_chute')
AIM = 0.01


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """A part in surroundings: counts by the ends as they are and when refined.

    counts : (1, m, m) int
        The m columns are the symmetry classes and OUTSIDE.
    members : (m,) int
        Number of aspects of each column, which have the same probability; 1 for OUTSIDE.
    """

    part: str
    surroundings: str
    counts: Counts
    members: Counts

    @property
    def name(self) -> str:
        """Part and surroundings, as cells of a table."""
        return f'{self.part} | {self.surroundings}'


def surroundings_steps(dropper: Dropper) -> Iterator[str]:
    """Compare drops in surroundings with the same drops in a refined simulation."""
    parts = {part.name: part for part in dropper.parts}
    named = [(parts[p], name) for name in SURROUNDINGS for p in PARTS]
    cases = [
        _case(dropper, part, name, SEED + k)
        for k, (part, name) in enumerate(track(named, 'surroundings'))
    ]
    yield '## Convergence in surroundings'
    yield ''
    yield (
        f'{DROPS} drops on `rubber_mat` in each of the surroundings, with the numerical '
        'parameters of the suite and again with all of them refined by a factor of '
        f'{REFINEMENT[KERNEL]}, from the same states; each case has a seed of its own. '
        'Aspects of a symmetry class have the same probability, because the orientations at the '
        'release are uniform; the shift of an aspect is therefore that of its class, divided by '
        f'the number of its aspects. The aim is a shift of at most {AIM} for each aspect.'
    )
    yield ''
    yield from _joint(cases)
    yield from _each(cases)


def _joint(cases: list[Case]) -> Iterator[str]:
    yield (
        '*Differ*: share of the drops that end in another class, or otherwise. *Shift*: largest '
        f'shift of an aspect, or of {", ".join(OUTSIDE)}, with its standard error, which follows '
        'from the drops that end differently. *Bound*: none of them changes by more than this, '
        'with a confidence of 95 %. *Chi-square*: of all shifts of a case together (Stuart and '
        'Maxwell), and *p*: probability of at least this value if the refinement has no effect.'
    )
    yield ''
    yield '| part | surroundings | differ | shift | error | bound | chi-square | p |'
    yield '|---|---|---|---|---|---|---|---|'
    total, degrees, bounds = 0.0, 0, []
    for case in cases:
        found, size = shifts(case.counts), case.members
        column = int(np.abs(found.shift[0] / size).argmax())
        bounds.append(_bound(found, size))
        value, freedom = homogeneity(case.counts[0])
        total, degrees = total + value, degrees + freedom
        yield (
            f'| {case.name} | {found.different:.3f} '
            f'| {found.shift[0, column] / size[column]:+.4f} '
            f'| {found.error[0, column] / size[column]:.4f} | {bounds[-1]:.4f} '
            f'| {_chi_square(value, freedom)} |'
        )
    yield f'| all | | | | | {max(bounds):.4f} | {_chi_square(total, degrees)} |'
    yield ''
    open_cases = [case for case, bound in zip(cases, bounds, strict=True) if bound > AIM]
    yield (
        f'The bound is at most {AIM}, which shows the aim, for {len(cases) - len(open_cases)} of '
        f'{len(cases)} cases.{_not_shown(open_cases)}'
    )
    yield ''


def _not_shown(cases: list[Case]) -> str:
    """Return a sentence on the cases for which the aim is not shown; empty if there are none."""
    if not cases:
        return ''
    names = ', '.join(f'{case.part} in {case.surroundings}' for case in cases)
    return (
        f' It is not shown for {names}: the number of drops does not suffice, or the shift '
        'exceeds it.'
    )


def _each(cases: list[Case]) -> Iterator[str]:
    yield (
        'Each class: *aspects*: their number; *share*: of all of them together, with the '
        'parameters of the suite; *shift* and *error*: of the class. Ends outside of the aspects '
        'are listed if there are any.'
    )
    yield ''
    yield '| part | surroundings | end | aspects | share | shift | error | shift / error |'
    yield '|---|---|---|---|---|---|---|---|'
    for case in cases:
        found, counts = shifts(case.counts), case.counts[0]
        classes = len(counts) - len(OUTSIDE)
        for k in np.flatnonzero(counts.sum(axis=0) + counts.sum(axis=1)).tolist():
            end = f'class {k + 1} | {case.members[k]}'
            if k >= classes:
                end = f'{OUTSIDE[k - classes]} | '
            shift, error = found.shift[0, k], found.error[0, k]
            yield (
                f'| {case.name} | {end} | {counts[k].sum() / counts.sum():.4f} | {shift:+.4f} '
                f'| {error:.4f} | {shift / error:+.1f} |'
            )
    yield ''


def _bound(found: Shifts, members: Counts) -> float:
    per_aspect = Shifts(found.shift / members, found.error / members, found.different)
    return per_aspect.bound


def _chi_square(value: float, degrees: int) -> str:
    return f'{value:.1f} ({degrees}) | {chi2.sf(value, degrees):.2f}' if degrees else '|'


def _case(dropper: Dropper, part: Part, name: str, seed: int) -> Case:
    job = make_job(part, with_surroundings(dropper.surfaces.get(), ra.surroundings(name)), seed)
    aspects = aspects_in(job.scene, find_aspects(part))
    labels = class_indices(aspects)
    members = [*np.bincount(labels).tolist(), *[1] * len(OUTSIDE)]
    counts = paired_counts(dropper, job, aspects, labels, DROPS)
    return Case(part.name, name, counts, np.array(members))
