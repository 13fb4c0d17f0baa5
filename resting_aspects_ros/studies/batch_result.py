"""The result of a batch: an entry for each part, and which parts share aspects."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED
from resting_aspects_ros.studies.study_cases import StudyCase
from resting_aspects_ros.studies.study_comparison import CaseComparison, compare_cases

# Of more parts, only the first ones are compared with each other.
MAX_COMPARED = 20


@dataclass(frozen=True, eq=False)
class BatchEntry:
    """A part of a batch.

    source : str
        Name or file, as it was given.
    result : DropResult or None
        None if the part failed.
    folder : str
        Folder of its report, in that of the batch.
    error : str
        Why it failed; empty otherwise.
    """

    source: str
    result: DropResult | None = None
    folder: str = ''
    error: str = ''

    @cached_property
    def case(self) -> StudyCase:
        """The counts as a case with one point."""
        assert self.result is not None
        assert self.result.part is not None
        found = self.result.distribution
        other = [found.unclassified, found.unsettled, found.failed, found.lost, found.sliding]
        return StudyCase(
            self.result.part,
            found.aspects,
            found.by_class().counts[None],
            np.array([other], dtype=np.int64),
        )

    @cached_property
    def pictures(self) -> list[str]:
        """A picture of each symmetry class as a data URI."""
        # This import takes about a second.
        from resting_aspects_ros.studies.page_parts import case_pictures

        return case_pictures(self.case)


@dataclass(frozen=True, eq=False)
class BatchResult:
    """The parts of a batch; ``complete`` if none failed and it was not stopped.

    seed : int
        From which the seeds of the parts follow.
    """

    entries: tuple[BatchEntry, ...]
    complete: bool
    confidence: float
    folder: Path | None = None
    seed: int = DEFAULT_SEED

    @cached_property
    def comparisons(self) -> list[CaseComparison]:
        """Pairs of parts that share aspects, as designs of one part do."""
        cases = [entry.case for entry in self.entries if entry.result is not None]
        found = compare_cases(cases[:MAX_COMPARED], self.confidence)
        return [each for each in found if each.shared]
