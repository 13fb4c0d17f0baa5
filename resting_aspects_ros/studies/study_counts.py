"""The counts of a study, what they depend on, and tables of them."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.errors import analysis, warn
from resting_aspects_ros.core.statistics.intervals import bounds
from resting_aspects_ros.studies.design import point_values
from resting_aspects_ros.studies.effects import Effects, effects_of, entropy
from resting_aspects_ros.studies.findings import Finding, findings_of
from resting_aspects_ros.studies.study_cases import ELSEWHERE, StudyCase
from resting_aspects_ros.studies.study_comparison import CaseComparison, compare_cases
from resting_aspects_ros.studies.study_spec import StudySpec

CSV, PARQUET, PAGE = 'results.csv', 'results.parquet', 'page.html'


@dataclass(frozen=True, eq=False)
class StudyCounts:
    """The counts of a study, and what they depend on.

    Attributes
    ----------
    spec : StudySpec
        Parts, factors, design and drops.
    points : (m, d) float
        Points in the unit cube; see ``values``.
    cases : tuple of StudyCase
        Counts by part and, for actions, by the class from which they start.
    complete : bool
        Whether all drops are made, except at impossible points.
    folder : Path or None
        Where the study is stored.
    """

    spec: StudySpec
    points: npt.NDArray[np.float64]
    cases: tuple[StudyCase, ...]
    complete: bool
    folder: Path | None = None

    @property
    def values(self) -> list[dict[str, float]]:
        """Values of the factors at each point, SI units."""
        return point_values(self.spec.factors, self.points)

    @cached_property
    def effects(self) -> list[Effects | None]:
        """Main effects, Sobol indices and largest changes of each case; None without counts."""
        spec = self.spec
        found: list[Effects | None] = [None] * len(self.cases)
        for k, case in enumerate(self.cases):
            with analysis(f'what the shares of {case.name} depend on'):
                found[k] = effects_of(case, self.points, spec.seed, spec.confidence)
        return found

    @cached_property
    def findings(self) -> list[Finding]:
        """What each factor does to each case, and whether measuring it is worth while."""
        spec = self.spec
        return [
            finding
            for case, effects in zip(self.cases, self.effects, strict=True)
            for finding in findings_of(
                case, effects, spec.factors, spec.tolerance, spec.confidence
            )
        ]

    @cached_property
    def comparisons(self) -> list[CaseComparison]:
        """The parts side by side, in pairs."""
        found: list[CaseComparison] = []
        with analysis('the comparison of the parts'):
            found += compare_cases(self.cases, self.spec.confidence)
        return found

    @property
    def rows(self) -> Iterator[dict[str, Any]]:
        """Rows of the table of results: one for each point, case and class."""
        values = self.values
        for case in self.cases:
            table = np.column_stack([case.classes, case.other.sum(axis=1)])
            lower, upper = bounds(table, case.drops, confidence=self.spec.confidence)
            names = [*case.class_names, ELSEWHERE]
            bits = entropy(table / np.maximum(case.drops, 1)[:, None])
            for point, count in np.ndindex(table.shape):
                drops = int(case.drops[point])
                yield {
                    'point': point,
                    **values[point],
                    'part': case.part.name,
                    'from_class': case.start,
                    'aspects': names[count],
                    'class': count + 1 if count < len(names) - 1 else None,
                    'count': int(table[point, count]),
                    'drops': drops,
                    'probability': float(table[point, count] / drops) if drops else None,
                    'lower': float(lower[point, count]),
                    'upper': float(upper[point, count]),
                    'entropy_bit': float(bits[point]) if drops else None,
                    'skipped': case.skipped.get(point, ''),
                }

    def save_tables(self, folder: str | Path) -> list[Path]:
        """Write results.csv and, if pyarrow is installed, results.parquet.

        Returns the paths; raises OutputError.
        """
        rows, folder = list(self.rows), Path(folder)
        with (
            whole_file(folder / CSV) as part,
            part.open('w', newline='', encoding='utf-8') as file,
        ):
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
        try:
            import pyarrow as pa
            from pyarrow import parquet
        except ImportError:
            warn(f'{PARQUET} needs pyarrow, which is not installed: pip install pyarrow')
            return [folder / CSV]
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        # Columns in which no row has a value have a type, too.
        types = {'from_class': pa.int64(), 'class': pa.int64()}
        table = pa.table(
            {name: pa.array(column, type=types.get(name)) for name, column in columns.items()}
        )
        with whole_file(folder / PARQUET) as part:
            parquet.write_table(table, part)
        return [folder / CSV, folder / PARQUET]
