"""Surroundings that goals name: files of a folder, documents, and no paths."""

import asyncio
import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.requests import RequestedSurroundings


class Files:
    """Runs functions at once, in this process."""

    async def run(self, function, *arguments):
        return function(*arguments)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'ramp.yaml').write_text('kind: slope\nangle: 20deg\n')
    (tmp_path / 'broken.yaml').write_text('kind: slope\nangle: 200deg\n')
    (tmp_path / 'plate.yaml').write_text('kind: mesh\nmesh: plate.obj\nunit: mm\n')
    (tmp_path / 'plate.obj').write_text('v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3\nf 1 3 4\n')
    return tmp_path


@pytest.fixture
def warnings():
    return []


@pytest.fixture
def requested(folder, warnings):
    logger = SimpleNamespace(warning=warnings.append)
    node = SimpleNamespace(get_name=lambda: 'drop_simulator', get_logger=lambda: logger)
    return RequestedSurroundings(node, str(folder), Files())


def ask(requested, text):
    return asyncio.run(requested.find(text))


def test_a_name_is_a_file_of_the_folder(requested):
    found = ask(requested, 'ramp')
    assert found == ra.surroundings('slope', angle='20deg')
    assert found.name == 'ramp'
    assert ask(requested, '') is None


def test_a_document_is_checked_and_made_canonical(requested):
    found = ask(requested, ' {"angle": 0.25,  "kind": "slope"}')
    assert found == ra.surroundings('slope', angle=0.25)
    assert found.key == ra.surroundings('slope', angle=0.25).key


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('swamp', "invalid surroundings 'swamp': expected a JSON document, or one of broken, "),
        ('../ramp', 'expected a JSON document, or one of'),
        ('broken', 'invalid angle'),
        ('{"kind": "slope", "angle": 9}', 'invalid angle'),
        ('{"kind": ', 'invalid surroundings'),
    ],
)
def test_invalid_surroundings(requested, text, expected):
    with pytest.raises(InvalidValueError) as caught:
        ask(requested, text)
    assert expected in str(caught.value)


def test_a_document_never_reads_a_path(requested, folder, warnings):
    document = {'kind': 'mesh', 'mesh': str(folder / 'plate.obj')}
    with pytest.raises(InvalidValueError, match='invalid mesh_sha256'):
        ask(requested, json.dumps(document))
    document['mesh_sha256'] = '0' * 64
    with pytest.raises(InvalidValueError, match='surroundings_folder of drop_simulator'):
        ask(requested, json.dumps(document))
    assert any('broken.yaml' in each for each in warnings)


def test_a_document_may_have_a_mesh_of_the_folder(requested, folder):
    plate = ra.surroundings(folder / 'plate.yaml')
    assert str(folder) not in plate.key
    found = ask(requested, plate.key)
    assert (found, found.name, found.known) == (plate, 'plate', True)
    raised = json.dumps({**plate.document, 'z': 0.1})
    np.testing.assert_allclose(
        ask(requested, raised).shape.vertices[:, 2], plate.shape.vertices[:, 2] + 0.1
    )


def test_surroundings_of_a_request(requested, surfaces):
    default, slope = surfaces.get(), ra.surroundings('slope', angle='20deg')
    plain = SimpleNamespace(conditions=[], surface='steel', surroundings='ramp')
    found = asyncio.run(requested.conditions(surfaces, plain, default))
    assert found == dataclasses.replace(surfaces.get('steel'), surroundings=slope)
    message = conditions_msg(surfaces.get('steel'))
    message.surroundings = 'ramp'
    given = SimpleNamespace(conditions=[message], surface='', surroundings='')
    assert asyncio.run(requested.conditions(surfaces, given, default)) == found


def test_a_missing_folder_is_an_error(tmp_path):
    with pytest.raises(InvalidValueError, match='invalid surroundings_folder'):
        RequestedSurroundings(None, str(tmp_path / 'none'), Files())
