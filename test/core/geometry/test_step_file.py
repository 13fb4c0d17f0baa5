"""STEP files are read with cascadio, in the unit that they state."""

import sys

import numpy as np
import pytest
from step_text import step_text

import resting_aspects_ros as ra
from resting_aspects_ros.core.errors import InvalidValueError, PartError
from resting_aspects_ros.core.part_loading import load_part

BOX = np.array([[x, y, z] for x in (0, 10) for y in (0, 20) for z in (0, 30)], dtype=float)
FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'Box 1.step'
    path.write_text(step_text(BOX, FACES))
    return path


def test_box_has_its_size_and_aspects(file):
    part = load_part(file)
    assert part.name == 'box_1'
    assert part.volume == pytest.approx(10 * 20 * 30e-9, rel=1e-5)
    np.testing.assert_allclose(part.centre_of_mass, [0.005, 0.01, 0.015], rtol=1e-5)
    assert len(ra.find_aspects(part)) == 6
    assert load_part(file).part_sha256 == part.part_sha256


def test_unit_is_that_of_the_file(tmp_path):
    path = tmp_path / 'box.stp'
    path.write_text(step_text(BOX, FACES, '.CENTI.'))
    assert load_part(path).volume == pytest.approx(10 * 20 * 30e-6, rel=1e-5)
    with pytest.raises(InvalidValueError, match='expected none, because the file has its own'):
        load_part(path, unit='cm')


def test_missing_package_is_named_with_its_installation(file, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cascadio', None)
    with pytest.raises(PartError, match='needs cascadio: pip install cascadio'):
        load_part(file)


@pytest.mark.parametrize('text', ['solid x', 'ISO-10303-21;\nHEADER;\n'])
def test_file_without_a_solid_is_refused(tmp_path, text):
    path = tmp_path / 'bad.step'
    path.write_text(text)
    with pytest.raises(PartError, match='STEP file'):
        load_part(path)
