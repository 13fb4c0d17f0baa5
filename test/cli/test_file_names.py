"""File names that are not UTF-8: messages are printable, and nothing crashes."""

import os

import pytest
from rclpy.serialization import serialize_message

from resting_aspects_ros.logs.topics import PART_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import part_msg

ODD = os.fsdecode(b'\xff')
SHOWN = r'\udcff'


@pytest.fixture
def log(tmp_path, part):
    """Write an unfinished log in a folder whose name is not UTF-8."""
    log = RunLog(tmp_path, 'run')
    topic = Topic('/parts/tetrahedron', PART_TYPE, Qos(1))
    log.write(topic, serialize_message(part_msg(part('tetrahedron'))), 1)
    log.flush()
    content = log.path.read_bytes()
    log.close()
    log.path.write_bytes(content)
    return log.path.parent.rename(tmp_path / ODD)


def test_file_with_a_name_invalid_in_metadata_is_not_recovered(run, log):
    assert f'{SHOWN}/run_0.mcap' in run('info', ODD).stdout
    (log / 'run_0.mcap').rename(log / f'{ODD}.mcap')
    ended = run('recover', ODD)
    assert ended.returncode == 1
    assert f"'{SHOWN}/{SHOWN}.mcap'" in ended.stderr
    assert [file.name for file in log.glob('*.mcap')] == [f'{ODD}.mcap']


@pytest.mark.parametrize(
    'words',
    [
        ['replay', ODD],
        ['nodes', '--ros-args', '-p', f'log_folder:={ODD}'],
        ['request', 'a', '--ros-args', '-r', f'__ns:=/{ODD}'],
    ],
    ids=lambda words: words[0],
)
def test_name_invalid_in_ros_is_refused(refused, words):
    said = refused(*words)
    assert SHOWN in said
    assert 'UTF-8' in said
