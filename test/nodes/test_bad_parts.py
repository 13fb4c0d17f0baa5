"""Unreadable files in a parts folder affect no other part and no request."""

import os
import shutil

import pytest
from resting_aspects_interfaces.msg import PartDescription, Status

from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, LATCHED
from resting_aspects_ros.ros.liveliness import announce
from resting_aspects_ros.simulation.conditions import parts_folder

SHEETS = {
    'stamped': 'mass: !!timestamp abc',
    'nothing': 'mass: !!int ""',
    'perhaps': 'mass: !!bool maybe',
    'hexadecimal': 'mass: 0x' + '9' * 4000,
    'nested': '[' * 5000,
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Create a folder with one good part, and one part for each kind of error."""
    folder = tmp_path_factory.mktemp('parts')
    mesh = parts_folder() / 'tetrahedron.stl'
    shutil.copy(mesh, folder)
    for name, text in SHEETS.items():
        shutil.copy(mesh, folder / f'{name}.stl')
        (folder / f'{name}.yaml').write_text(text)
    shutil.copy(mesh, folder / 'piped.stl')
    os.mkfifo(folder / 'piped.yaml')
    os.mkfifo(folder / 'pipe.stl')
    (folder / 'device.stl').symlink_to('/dev/zero')
    (folder / 'slow.obj').write_text('v ' + '0' * 200_000 + 'x\n')
    with (folder / 'huge.stl').open('wb') as file:
        file.truncate(8 * 1024**3)
    return folder


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    return fresh_suite(
        {'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2}},
        parts_folder=folder,
        workers=1,
    )


@pytest.mark.timeout(1800)
def test_bad_files_do_not_affect_other_parts(suite, folder, diagnostics_of):
    assert suite.client.ask(drops=5, seed=[1]).status.code == Status.OK
    _, _, values = diagnostics_of(suite.client).wait(
        'drop_simulator', lambda *status: 'not offered: slow' in status[2], 'reasons'
    )
    not_offered = {key.removeprefix('not offered: ') for key in values if 'not offered: ' in key}
    assert not_offered >= {*SHEETS, 'piped', 'slow', 'huge'}
    refused = suite.client.drop('slow', 5).result.status
    assert refused.code == Status.INVALID
    assert 'slow' in refused.message
    # The folder is still scanned for new parts.
    shutil.copy(parts_folder() / 'washer.stl', folder)
    suite.client.wait(lambda: list(suite.client.parts()) == ['tetrahedron', 'washer'], 'washer')
    assert suite.client.drop('washer', 5).outcome == 'succeeded'
    assert suite.alive


def test_rejected_part_gets_an_error_response(start, connect, namespace, part):
    """The simulator offers it, for example because it is another version of the suite."""
    client = connect(namespace)
    simulator = announce(client.node, DROP_SIMULATOR)
    message = part_msg(part('tetrahedron'))
    message.mesh = list(b'no mesh')
    description = client.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
    description.publish(message)
    classifier = start('aspect_classifier', namespace, {'log_folder': "''"})
    client.wait(lambda: 'cannot be used' in classifier.output, 'warning')
    for only_known in (True, False):
        status = client.ask(surface='steel', only_known=only_known).status
        assert status.code == Status.INVALID
        assert status.message.startswith("part 'tetrahedron' cannot be used: ")
    client.node.destroy_publisher(simulator)
