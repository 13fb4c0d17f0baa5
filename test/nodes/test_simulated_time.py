"""Nodes with use_sim_time keep running without a clock publisher."""

import time

import pytest
from resting_aspects_interfaces.msg import AspectDistribution, Status
from ros_graph import Diagnostics

from resting_aspects_ros.ros.interface import LATCHED

NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
YEAR = 365 * 86_400


@pytest.mark.slow
def test_nodes_work_without_a_clock_publisher(start, connect, namespace, few_parts, tmp_path):
    client = connect(namespace)
    for node in NODES:
        given = {'log_folder': tmp_path}
        if node == 'drop_simulator':
            given = {'parts_folder': few_parts('tetrahedron')}
        start(node, namespace, {'use_sim_time': 'true', **given})
    received = client.listen(AspectDistribution, 'aspect_distributions/tetrahedron', LATCHED)
    diagnostics = Diagnostics(client)
    answer = client.ask('tetrahedron', 20)
    assert answer.status.code == Status.OK
    run = answer.distribution.run
    assert abs(run.started.sec - time.time()) < YEAR
    client.wait(lambda: received and received[-1].complete, 'distribution on its topic')
    client.wait(lambda: list(tmp_path.glob(f'*_{run.run_id}/metadata.yaml')), 'log')
    # Stamps of messages are ROS time, as everywhere.
    assert answer.distribution.header.stamp.sec == 0
    for node in NODES:
        diagnostics.wait(node, lambda *_: True, node)
