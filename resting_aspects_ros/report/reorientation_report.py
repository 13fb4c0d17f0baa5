"""The content of a report on transitions and retention curves, and the names of its files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.page_template import ENDINGS
from resting_aspects_ros.statistics.markov import LongRun, Plan
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

# The page on actions, and that on retention curves.
PAGE, RETENTION_PAGE = 'reorientation.html', 'retention.html'
HEAT_MAP, RETENTION = 'transitions', 'retention'
MEASURED = ('from', 'to', 'measured', 'simulated', 'difference in points', 'verdict')


@dataclass(frozen=True, eq=False)
class Shares:
    """Long-run shares of aspects or of symmetry classes, with bounds, and the shares of a drop."""

    long_run: LongRun
    lower: Array
    upper: Array
    drop: Array


@dataclass(frozen=True, eq=False)
class Way:
    """How each aspect leads to the wanted aspects; see wanted_table."""

    wanted: npt.NDArray[Any]
    probability: Array
    actions: Array


@dataclass(frozen=True, eq=False)
class ActionReport:
    """The content of a page on one action.

    name : str
        Of the action.
    text : str
        The kind of the action, and how often it was simulated.
    source : str
        Origin of its values; may be empty.
    title : str
        Title of the figures in files of their own.
    values : sequence of (str, str)
        Label and value of each number of the action.
    drop : str
        A sentence that describes the drops.
    matrix : TransitionMatrix
        By aspect.
    shares : (Shares, Shares) or None
        By symmetry class and by aspect; None if they are not known.
    way : Way or None
        By aspect; None without wanted aspects.
    measured : sequence of rows
        Cells below the headings MEASURED.
    convergence : str
        Result of a check with a finer time step.
    notes : sequence of str
        Sentences that are shown first, such as warnings.
    """

    name: str
    text: str
    title: str
    values: Sequence[tuple[str, str]]
    drop: str
    matrix: TransitionMatrix
    source: str = ''
    shares: tuple[Shares, Shares] | None = None
    way: Way | None = None
    measured: Sequence[Sequence[str]] = ()
    convergence: str = ''
    notes: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class ReorientationReport:
    """The content of a page.

    title, subtitle : str
        The part, and the actions or disturbances in a few words.
    actions : sequence of ActionReport
        Different names.
    wanted : tuple of int
        Ids of the wanted aspects.
    plan : (Plan, names of the actions) or None
    curves : sequence of RetentionCurve
    gravity : float
        With which the curves were simulated, m/s2.
    notes, facts
        As in Report.
    """

    title: str
    subtitle: str
    part: Part
    aspects: AspectSet
    confidence: float
    actions: Sequence[ActionReport] = ()
    wanted: tuple[int, ...] = ()
    plan: tuple[Plan, Sequence[str]] | None = None
    curves: Sequence[RetentionCurve] = ()
    gravity: float = 9.81
    notes: Sequence[str] = ()
    facts: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)


def reorientation_file_names(actions: Sequence[str]) -> list[str]:
    """Return the names of all files of a page on these actions; without any, on retention."""
    figures = [HEAT_MAP + suffix_of(name, actions) for name in actions]
    page = PAGE if actions else RETENTION_PAGE
    return [page, *(f'{each}.{ending}' for each in figures or [RETENTION] for ending in ENDINGS)]


def suffix_of(action: str, actions: Sequence[str]) -> str:
    """Return the end of the names of the files of one of several actions, such as '_tap'."""
    return f'_{action}' if len(actions) > 1 else ''
