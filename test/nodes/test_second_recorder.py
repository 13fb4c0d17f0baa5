"""A second recorder: refused in the same namespace and folder, welcome in another namespace."""

import pytest
from resting_aspects_interfaces.msg import RestingPoses

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.drop_recorder.log_folder import FolderLock
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES


def test_second_recorder_needs_another_namespace(
    start, connect, namespace, tmp_path, wait, batches
):
    first = start('drop_recorder', namespace, {'log_folder': tmp_path})
    second = start('drop_recorder', namespace, {'log_folder': tmp_path}, ready='')
    wait(lambda: not second.running, 'end of the second')
    assert second.end() == 2
    assert second.output == (
        f"error: invalid log_folder '{tmp_path}': expected a folder in which no other "
        'drop_recorder of this namespace writes logs\n'
    )
    other = f'{namespace}_other'
    start('drop_recorder', other, {'log_folder': tmp_path})
    for each, run_id in ((namespace, 'run_1'), (other, 'run_2')):
        client = connect(each)
        publisher = client.node.create_publisher(RestingPoses, RESTING_POSES, POSES)
        for batch in batches(1, run_id):
            publisher.publish(batch)
        client.wait(lambda run_id=run_id: list(tmp_path.glob(f'*_{run_id}')), 'log')
    # After the death of the first its place is free.
    first.destroy()
    start('drop_recorder', namespace, {'log_folder': tmp_path})


def test_lock_moves_with_the_folder(tmp_path):
    mine, other = FolderLock('/cell'), FolderLock('/cell')
    mine.take(tmp_path / 'a')
    other.take(tmp_path / 'b')
    with pytest.raises(InvalidValueError, match=r'^invalid log_folder .*a.: expected a folder in'):
        other.take(tmp_path / 'a')
    with pytest.raises(InvalidValueError, match=r'b.: expected a folder in which no other'):
        mine.take(tmp_path / 'b')  # what it had is kept
    mine.take(tmp_path / 'c')
    other.take(tmp_path / 'a')
    mine.release()
    other.take(tmp_path / 'c')
