"""parts/<part> and list_parts follow the folder of the simulator."""

import shutil

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from rclpy.task import Future
from resting_aspects_interfaces.msg import PartDescription, Status

from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.ros.conversions import part_from, part_msg
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.simulation.conditions import parts_folder


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('parts')
    for name in ('box_10x20x30.stl', 'tetrahedron.stl'):
        shutil.copy(parts_folder() / name, folder)
    return folder


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    return fresh_suite(
        {'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2}},
        parts_folder=folder,
        workers=1,
    )


@pytest.fixture
def listed(suite):
    """Wait until list_parts returns these names, and return the summaries."""

    def listed(*names):
        def found():
            parts = suite.client.parts()
            return list(parts) == list(names) and parts

        return suite.client.wait(found, f'list of {names}')

    return listed


def test_parts_are_listed_by_name_with_their_hashes(listed, folder):
    parts = listed('box_10x20x30', 'tetrahedron')
    for name, summary in parts.items():
        assert summary.part_sha256 == PartLibrary(folder).load(name).part_sha256


def test_part_is_known_after_a_run(suite, listed):
    assert not listed('box_10x20x30', 'tetrahedron')['tetrahedron'].known
    suite.client.ask('tetrahedron', 3)
    parts = listed('box_10x20x30', 'tetrahedron')
    assert (parts['tetrahedron'].known, parts['box_10x20x30'].known) == (True, False)


def test_file_name_that_is_not_utf8_is_reported(suite, folder, diagnostics_of):
    mesh = folder / '\udcff.stl'
    shutil.copy(parts_folder() / 'tetrahedron.stl', mesh)
    simulator = suite.processes['drop_simulator']
    expected = r'\udcff.stl in '
    suite.client.wait(lambda: expected in simulator.output or not simulator.running, 'word of it')
    _, message, values = diagnostics_of(suite.client).wait(
        'drop_simulator', lambda level, *_: level == DiagnosticStatus.WARN, 'warning'
    )
    assert '1 mesh is not offered' in message
    assert expected in values[r'not offered: \udcff.stl']
    assert suite.client.ask('tetrahedron', 3).status.code == Status.OK
    mesh.unlink()


def test_part_is_not_known_after_a_run_without_drops(suite, listed):
    box = suite.client.dropping('box_10x20x30', 2_000_000, first_drop=9)
    box.cancel()
    suite.client.wait(lambda: box.done, 'canceled goal')
    assert box.result.status.code == Status.CANCELED
    parts = listed('box_10x20x30', 'tetrahedron')
    assert parts['box_10x20x30'].known == (box.result.drops > 0)


def test_description_contains_the_mesh_file(suite, folder):
    received = suite.client.listen(PartDescription, 'parts/tetrahedron', LATCHED)
    suite.client.wait(lambda: received, 'description')
    assert bytes(received[0].mesh) == (folder / 'tetrahedron.stl').read_bytes()
    again = part_from(received[0])
    assert again.part_sha256 == received[0].part_sha256
    assert again.part_sha256 == PartLibrary(folder).load('tetrahedron').part_sha256


def test_parts_can_be_added_changed_and_removed(suite, listed, folder):
    received = suite.client.listen(PartDescription, 'parts/hex_nut', LATCHED)
    shutil.copy(parts_folder() / 'hex_nut.stl', folder)
    before = listed('box_10x20x30', 'hex_nut', 'tetrahedron')['hex_nut'].part_sha256
    suite.client.wait(lambda: received, 'description of the new part')
    assert received[-1].part_sha256 == before
    suite.client.ask('hex_nut', 3, seed=[1])

    (folder / 'hex_nut.yaml').write_text('density: 2700\n', encoding='utf-8')

    def changed():
        return suite.client.parts()['hex_nut'].part_sha256 not in ('', before)

    suite.client.wait(changed, 'another hash')
    suite.client.wait(
        lambda: received[-1].part_sha256 != before, 'description of the changed part'
    )
    assert received[-1].mesh_sha256 == received[0].mesh_sha256
    # No distribution of the current version is known.
    assert not suite.client.parts()['hex_nut'].known
    old = suite.client.ask('hex_nut', 3, seed=[1], only_known=True)
    assert old.status.code == Status.NOT_AVAILABLE
    new = suite.client.ask('hex_nut', 3, seed=[1])
    assert new.distribution.run.part_sha256 == received[-1].part_sha256

    (folder / 'hex_nut.stl').unlink()
    (folder / 'hex_nut.yaml').unlink()
    listed('box_10x20x30', 'tetrahedron')
    answer = suite.client.ask('hex_nut', 3, seed=[1])
    assert answer.status.code == Status.UNKNOWN_PART
    assert 'known parts: box_10x20x30, tetrahedron' in answer.status.message


def test_broken_mesh_is_reported_once(suite, listed, folder):
    simulator = suite.processes['drop_simulator']
    (folder / 'broken.stl').write_bytes(b'no mesh')
    suite.client.wait(lambda: 'broken.stl' in simulator.output, 'warning')
    assert suite.client.ask('tetrahedron', 4, seed=[9]).status.code == Status.OK
    listed('box_10x20x30', 'tetrahedron')
    # Several scans have been made when the added part is offered.
    shutil.copy(parts_folder() / 'washer.stl', folder)
    listed('box_10x20x30', 'tetrahedron', 'washer')
    (folder / 'washer.stl').unlink()
    listed('box_10x20x30', 'tetrahedron')
    assert simulator.output.count('broken.stl') == 1
    (folder / 'broken.stl').unlink()


def test_diagnostics_list_meshes_that_are_not_offered(suite, folder, diagnostics_of):
    diagnostics = diagnostics_of(suite.client)
    (folder / 'empty.stl').write_bytes(b'no mesh either')
    shutil.copy(parts_folder() / 'washer.stl', folder / 'My Washer.stl')
    expected = '2 meshes are not offered'
    level, _, values = diagnostics.wait('drop_simulator', lambda _, m, __: m == expected, expected)
    assert level == DiagnosticStatus.WARN
    assert 'empty.stl' in values['not offered: empty']
    assert 'expected a name of lower case' in values['not offered: My Washer.stl']
    (folder / 'empty.stl').unlink()
    diagnostics.wait('drop_simulator', lambda _, m, __: m == '1 mesh is not offered', 'one')
    (folder / 'My Washer.stl').unlink()
    diagnostics.wait('drop_simulator', lambda level, *_: level == DiagnosticStatus.OK, 'none')


@pytest.mark.slow
def test_request_waits_while_parts_arrive(fresh_suite):
    suite = fresh_suite({'aspect_classifier': {'ros.topic_discovery.PERIOD': 1.5}}, workers=1)
    suite.processes['aspect_classifier'].end()
    suite.start_again('aspect_classifier')
    # It does not discover parts before 1.5 s have passed.
    assert suite.client.ask('washer', method='rolling').status.code == Status.OK
    unknown = suite.client.ask('no_such_part', method='rolling').status
    assert unknown.code == Status.UNKNOWN_PART
    assert unknown.message.endswith(', u_bracket, washer')


def test_rapidly_repeated_description_is_read(part):
    """A looped replay repeats it for a slow classifier."""

    class Files:
        """Read when the gate opens."""

        gate = Future()

        async def run(self, function, *given):
            await self.gate
            return function(*given)

    def advance(coroutine):
        """Run the coroutine until it waits; return whether it has ended."""
        try:
            coroutine.send(None)
        except StopIteration:
            return True
        return False

    described = serialize_message(part_msg(part('tetrahedron')))
    changes = []
    known = PartRegistry(None, Files(), changes.append)
    reading = known.describe('tetrahedron', described)
    assert not advance(reading)
    assert advance(known.describe('tetrahedron', described))
    Files.gate.set_result(None)
    assert advance(reading)
    assert known.get('tetrahedron').part_sha256 == part('tetrahedron').part_sha256
    assert advance(known.describe('tetrahedron', described))
    assert len(changes) == 1
    known.remove('tetrahedron')
    assert advance(known.describe('tetrahedron', described))
    assert len(changes) == 2
