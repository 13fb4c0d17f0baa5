"""Studies whose counts say little still have their tables and their page."""

import csv
import html
import warnings

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.points import Case
from resting_aspects_ros.studies.study import StudyResult, StudySpec

HEIGHT, FRICTION = Factor('height', 0.02, 0.2, 3), Factor('friction', 0.1, 0.5, 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('table', 'lost', 'factors'),
    # Counts (3, c) of a class or two at three heights, and lost drops (3,).
    [
        ([[20], [20], [0]], [0, 0, 20], (HEIGHT, FRICTION)),
        ([[12, 8], [0, 0], [0, 0]], [0] * 3, (HEIGHT,)),
        ([[20, 0], [10, 0], [0, 0]], [0, 10, 20], (HEIGHT, FRICTION)),
        ([[0, 0]] * 3, [0] * 3, (HEIGHT, FRICTION)),
    ],
    ids=['one class, some lost', 'one point', 'a class that never occurs', 'no drops'],
)
def test_degenerate_counts_have_tables_findings_and_a_page(table, lost, factors, tmp_path):
    table, lost = np.array(table), np.array(lost)
    part = ra.load_part('tetrahedron' if table.shape[1] == 1 else 'washer')
    aspects = ra.find_aspects(part)
    assert len(aspects.classes()) == table.shape[1]
    base = Setting(shipped_surfaces().get(DEFAULT_SURFACE), None, None)
    spec = StudySpec((part,), base, factors, 'factorial')
    design = spec.made_design()
    row = (2 * design.points[:, 0]).astype(int)
    other = np.zeros((len(row), 5), dtype=np.int64)
    other[:, 3] = lost[row]
    case = Case(part, aspects, table[row], other)
    fresh = {k: np.append(table[each], lost[each]) for k, each in enumerate(row)}
    result = StudyResult(spec, design, (case,), True, None, (fresh,))
    with warnings.catch_warnings():
        warnings.simplefilter('error', ra.RestingAspectsWarning)  # no analysis fails
        result.save_tables(tmp_path)
        page = result.report(tmp_path).read_text()
        findings = result.findings
    with (tmp_path / 'results.csv').open() as file:
        assert len(list(csv.DictReader(file))) == len(row) * (table.shape[1] + 1)
    assert len(findings) == len(factors)
    assert all(finding.sentence in html.unescape(page) for finding in findings)
