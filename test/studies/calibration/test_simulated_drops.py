"""Simulated drops are kept, even if the work is broken off."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import OutputError
from resting_aspects_ros.studies.calibration import simulated_drops
from resting_aspects_ros.studies.calibration.simulated_drops import BATCH, SimulatedDrops
from resting_aspects_ros.studies.points import PointCounts

DROPS = 10


class BrokenOffError(Exception):
    """The work is broken off."""


@pytest.fixture
def simulated(monkeypatch):
    """Batches that were simulated; the work is broken off after ``limit`` of them."""
    batches = []

    class Log:
        limit = 100
        points = batches

    def drop_points(part, points, drops, seed, **_):
        if len(batches) == Log.limit:
            raise BrokenOffError
        batches.append([point.friction for point in points])
        aspects = find_aspects(part)
        counts = np.zeros((len(points), len(aspects)), dtype=np.int64)
        counts[:, 0] = [round(drops * point.friction) for point in points]
        other = np.zeros((len(points), 5), dtype=np.int64)
        other[:, 0] = drops - counts[:, 0]
        return PointCounts(aspects, counts, other)

    monkeypatch.setattr(simulated_drops, 'drop_points', drop_points)
    return Log


def test_broken_off_work_is_continued(simulated, part, surfaces, tmp_path):
    file = tmp_path / 'drops.json'
    points = [surfaces.get().changed(friction=(k + 1) / 100) for k in range(2 * BATCH + 1)]
    simulated.limit = 1
    with pytest.raises(BrokenOffError):
        SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    simulated.limit = 100
    found = SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    frictions = [point.friction for point in points]
    assert [f for batch in simulated.points for f in batch] == frictions
    assert found[:, 0].tolist() == [round(DROPS * f) for f in frictions]


def test_drops_of_another_seed_or_number_are_not_taken(simulated, part, surfaces, tmp_path):
    file = tmp_path / 'drops.json'
    points = [surfaces.get()]
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    assert len(simulated.points) == 1
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS + 1)
    SimulatedDrops(None, 2, file=file).counts(part('tetrahedron'), points, DROPS)
    assert len(simulated.points) == 3


def test_drops_of_other_versions_are_not_taken(simulated, part, surfaces, tmp_path, monkeypatch):
    file, points = tmp_path / 'drops.json', [surfaces.get()]
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    monkeypatch.setattr(simulated_drops, 'worker_versions', lambda: {'numpy': '1.0'})
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    assert len(simulated.points) == 2


def test_full_disk_keeps_the_drops_that_are_saved(
    simulated, part, surfaces, tmp_path, monkeypatch
):
    file = tmp_path / 'drops.json'
    points = [surfaces.get().changed(friction=(k + 1) / 100) for k in range(2 * BATCH)]
    write, texts = Path.write_text, []

    def full(path, text, **options):
        if texts:
            write(path, text[:20], **options)
            raise OSError(errno.ENOSPC, 'No space left on device')
        texts.append(text)
        write(path, text, **options)

    monkeypatch.setattr(Path, 'write_text', full)
    with pytest.raises(OutputError, match='No space left on device'):
        SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), points, DROPS)
    monkeypatch.undo()
    assert file.read_text(encoding='utf-8') == texts[0]
    assert len(json.loads(texts[0])['counts']) == BATCH


@pytest.mark.parametrize('text', ['', '{', '[]', '{"counts": {}}', 'null'])
def test_file_that_cannot_be_read_is_replaced(simulated, part, surfaces, tmp_path, text):
    file = tmp_path / 'drops.json'
    file.write_text(text, encoding='utf-8')
    SimulatedDrops(None, 1, file=file).counts(part('tetrahedron'), [surfaces.get()], DROPS)
    assert len(simulated.points) == 1
    assert len(json.loads(file.read_text(encoding='utf-8'))['counts']) == 1
