"""The counts of a study, by part and, for actions, by the class from which they start."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.studies.point_runs import counts_by_class

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

ELSEWHERE = 'elsewhere'


@dataclass(frozen=True, eq=False)
class StudyCase:
    """Counts of one part, or of an action on a part at rest in one class, at m points.

    start : int or None
        Number of the symmetry class from which the actions start; None: dropped.
    classes : (m, c) int
        Drops in each symmetry class.
    other : (m, 5) int
        Drops that ended otherwise; columns as in point_plans.OTHER.
    skipped : dict of int to str
        Why points are impossible for this part.
    """

    part: Part
    aspects: AspectSet
    classes: Counts
    other: Counts
    start: int | None = None
    skipped: dict[int, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The part, and the start if there is one."""
        if self.start is None:
            return self.part.name
        return f'{self.part.name} from {self.class_names[self.start - 1]}'

    @property
    def class_names(self) -> list[str]:
        """Names of the symmetry classes, such as 'aspects 1 and 2'."""
        members = self.aspects.classes()
        return [f'aspect{"s" * (len(alike) > 1)} {ids_text(alike)}' for alike in members]

    @property
    def drops(self) -> Counts:
        """(m,) number of drops at each point."""
        return np.asarray(self.classes.sum(axis=1) + self.other.sum(axis=1))

    @property
    def columns(self) -> list[str]:
        """Names of the columns of ``table``."""
        return [*self.class_names, *([ELSEWHERE] if self.other.any() else [])]

    @property
    def table(self) -> Counts:
        """Counts (m, c) by class, with a column for drops in none of them if there are any."""
        if not self.other.any():
            return self.classes
        return np.column_stack([self.classes, self.other.sum(axis=1)])


def cases_of(
    part: Part,
    aspects: AspectSet,
    counts: Counts,
    skipped: dict[int, str],
) -> Iterator[StudyCase]:
    """Yield the cases of a part from counts (m, starts, k + 5)."""
    k = len(aspects)
    found = counts_by_class(aspects, counts[..., :k])
    other = counts[..., k:]
    if counts.shape[1] == 1:
        yield StudyCase(part, aspects, found[:, 0], other[:, 0], skipped=skipped)
        return
    for number, members in enumerate(aspects.classes(), 1):
        rows = [aspect.id - 1 for aspect in members]
        yield StudyCase(
            part,
            aspects,
            found[:, rows].sum(axis=1),
            other[:, rows].sum(axis=1),
            number,
            skipped,
        )
