"""Invalid messages are ignored and logged, and the nodes continue."""

import copy
import math
from array import array

import pytest
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import PartDescription, RestingPoses

from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.interface import LATCHED, POSES

# Fields of a batch and their invalid values.
ODD_BATCHES = [
    ('orientation', math.nan),
    ('run.part', '../../etc/x'),
    ('run.run_id', '../../x'),
    ('first_drop', 2**64 - 1),
    ('run.conditions.height', math.nan),
]


@pytest.fixture
def client(connect, namespace):
    return connect(namespace)


@pytest.fixture
def batch(batches):
    """Return a function that creates the only batch of a run."""

    def batch(run_id):
        (data,) = batches(1, run_id)
        return deserialize_message(data, RestingPoses)

    return batch


@pytest.fixture
def described(client, part):
    """Publish the tetrahedron as a simulator describes it."""
    publisher = client.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
    publisher.publish(part_msg(part('tetrahedron')))
    return publisher


def changed(message, path, value):
    """Return the message with one field changed, by its path."""
    message = copy.deepcopy(message)
    *path, name = path.split('.')
    entry = message
    for step in path:
        entry = getattr(entry, step)
    if isinstance(column := getattr(entry, name), array):
        column[0] = value
    else:
        setattr(entry, name, value)
    return message


def log_of(client, folder, run_id):
    """Return the folder of the log of a run, once it is complete."""
    found = client.wait(lambda: list(folder.glob(f'*_{run_id}/metadata.yaml')), f'log of {run_id}')
    return found[0].parent


@pytest.mark.slow
def test_invalid_batch_is_ignored_and_the_next_is_counted(
    start, client, namespace, batch, part, described, tmp_path
):
    nodes = [
        start(node, namespace, {'log_folder': tmp_path})
        for node in ('aspect_classifier', 'drop_recorder')
    ]
    # A topic whose name is not a valid part name.
    publisher = client.node.create_publisher(PartDescription, 'parts/Zz', LATCHED)
    publisher.publish(part_msg(part('tetrahedron')))
    # A description of another part.
    strange = client.node.create_publisher(PartDescription, 'parts/zz', LATCHED)
    strange.publish(part_msg(part('tetrahedron')))
    out = client.node.create_publisher(RestingPoses, 'resting_poses', POSES)
    for turn in ('first', 'second'):
        for k, (path, value) in enumerate(ODD_BATCHES):
            out.publish(changed(batch(f'odd_{turn}_{k}'), path, value))
        good = batch(f'good_{turn}')
        good.header.stamp.sec = -5  # a log has no times before the epoch
        out.publish(good)
        log_of(client, tmp_path, f'good_{turn}')

    assert client.known('tetrahedron', 250, surface='rubber_mat').drops == 250
    assert {path.name.partition('Z_')[2] for path in tmp_path.iterdir()} == {
        'good_first',
        'good_second',
    }
    for node in nodes:
        # Each kind of error is logged once for any number of messages.
        error = f'ignored a message on {namespace}/resting_poses: invalid orientation'
        assert node.output.count(error) == 1, node.output
        client.wait(
            lambda node=node: "invalid description of part 'zz'" in node.output, 'refused part'
        )
