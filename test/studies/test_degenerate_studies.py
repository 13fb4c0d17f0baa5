"""Studies whose counts say little still have their tables and their page."""

import csv
import warnings

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.simulation.surfaces import DEFAULT_SURFACE
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.study_cases import StudyCase
from resting_aspects_ros.studies.study_result import StudyResult
from resting_aspects_ros.studies.study_spec import StudySpec

HEIGHT, FRICTION = Factor('height', 0.02, 0.2), Factor('friction', 0.1, 0.5)
# Counts (m, c) of a class or two, and lost drops (m,).
TABLES = {
    'one class': ([[20], [20], [20], [20]], [0] * 4),
    'one class, some lost': ([[20], [20], [0], [0]], [0, 0, 20, 20]),
    'one class, few lost': ([[19], [20], [20], [20]], [1, 0, 0, 0]),
    'one point': ([[12, 8]], [0]),
    'one point, one class': ([[20]], [0]),
    'two points': ([[12, 8], [0, 20]], [0, 0]),
    'two points, one empty': ([[12, 8], [0, 0]], [0, 0]),
    'all in one of two classes': ([[20, 0], [20, 0], [20, 0]], [0] * 3),
    'a class that never occurs, some lost': ([[20, 0], [10, 0], [0, 0]], [0, 10, 20]),
    'no effect': ([[10, 10]] * 5, [0] * 5),
    'all lost': ([[0, 0]] * 3, [20] * 3),
    'one drop at each point': ([[1, 0], [0, 1], [1, 0], [0, 0]], [0, 0, 0, 1]),
    'no drops': ([[0, 0]] * 3, [0] * 3),
}


@pytest.mark.parametrize('factors', [(HEIGHT,), (HEIGHT, FRICTION)], ids=['one', 'two'])
@pytest.mark.parametrize('name', TABLES)
def test_degenerate_counts_have_tables_findings_and_a_page(name, factors, tmp_path):
    table, lost = TABLES[name]
    part = ra.load_part('tetrahedron' if len(table[0]) == 1 else 'washer')
    aspects = ra.find_aspects(part)
    assert len(aspects.classes()) == len(table[0])
    other = np.zeros((len(table), 5), dtype=np.int64)
    other[:, 3] = lost
    case = StudyCase(part, aspects, np.array(table), other)
    points = np.random.default_rng(1).random((len(table), len(factors)))
    base = Setting(shipped_surfaces().get(DEFAULT_SURFACE), None, None)
    result = StudyResult(StudySpec((part,), base, factors), points, (case,), True, None)
    with warnings.catch_warnings():
        warnings.simplefilter('error', ra.RestingAspectsWarning)  # no analysis fails
        result.save_tables(tmp_path)
        page = result.report(tmp_path).read_text()
        findings = result.findings
    with (tmp_path / 'results.csv').open() as file:
        assert len(list(csv.DictReader(file))) == len(table) * (len(table[0]) + 1)
    assert len(findings) == len(factors)
    assert all(finding.sentence in page for finding in findings)
