"""parts/<part> follows the folder of the simulator."""

import shutil

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from resting_aspects_interfaces.msg import PartDescription, Status
from ros_graph import Diagnostics

from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.system import parts_folder


@pytest.fixture(scope='module')
def folder(few_parts):
    return few_parts('tetrahedron')


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    quick = {'drop_simulator': {'nodes.drop_simulator.node.SCAN_PERIOD': 0.2}}
    return fresh_suite(quick, parts_folder=folder, workers=1)


@pytest.fixture
def listed(suite):
    """Wait until these parts are offered."""
    parts = suite.client.parts
    return lambda *names: suite.client.wait(lambda: list(parts()) == [*names], f'list of {names}')


@pytest.mark.slow
def test_parts_can_be_added_changed_and_removed(suite, listed, folder):
    def answered(code, **fields):
        """Wait for a status, which comes when the classifier has read the parts."""

        def found():
            return suite.client.ask('hex_nut', 3, seed=[1], **fields).status.code == code

        suite.client.wait(found, f'status {code}')

    received = suite.client.listen(PartDescription, 'parts/hex_nut', LATCHED)
    shutil.copy(parts_folder() / 'hex_nut.stl', folder)
    listed('hex_nut', 'tetrahedron')
    suite.client.wait(lambda: received, 'description of the new part')
    before = received[-1].part_sha256
    suite.client.ask('hex_nut', 3, seed=[1])

    (folder / 'hex_nut.yaml').write_text('density: 2700\n', encoding='utf-8')
    suite.client.wait(lambda: received[-1].part_sha256 != before, 'changed part')
    assert received[-1].mesh_sha256 == received[0].mesh_sha256
    # No distribution of the current version is known.
    answered(Status.NOT_AVAILABLE, only_known=True)
    new = suite.client.ask('hex_nut', 3, seed=[1])
    assert new.distribution.run.part_sha256 == received[-1].part_sha256

    for name in ('hex_nut.stl', 'hex_nut.yaml'):
        (folder / name).unlink()
    listed('tetrahedron')
    answered(Status.UNKNOWN_PART)


def test_mesh_that_is_not_offered_is_reported_once(suite, listed, folder):
    simulator, diagnostics = suite.nodes['drop_simulator'], Diagnostics(suite.client)
    (folder / 'broken.stl').write_bytes(b'no mesh')
    _, _, values = diagnostics.wait(
        'drop_simulator', lambda level, *_: level == DiagnosticStatus.WARN, 'warning'
    )
    assert 'broken.stl' in values['not offered: broken']
    assert suite.client.ask('tetrahedron', 4, seed=[9]).status.code == Status.OK
    # Several scans have been made when the added part is offered.
    shutil.copy(parts_folder() / 'washer.stl', folder)
    listed('tetrahedron', 'washer')
    assert simulator.output.count('broken.stl') == 1
    for name in ('washer.stl', 'broken.stl'):
        (folder / name).unlink()
    diagnostics.wait('drop_simulator', lambda level, *_: level == DiagnosticStatus.OK, 'none')
