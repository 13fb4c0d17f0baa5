"""Mixed requests for minutes: no node dies, and none grows."""

import os
import random
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose

from resting_aspects_ros.ros.interface import SERVICES

PARTS = ('tetrahedron', 'box_10x20x30', 'l_bracket', 'hex_nut', 'washer')
# How long mixed requests go on: 30 minutes by hand, 2 with all other tests.
MINUTES = float(os.environ.get('RESTING_ASPECTS_HARD_USE_MINUTES', '2'))


def resident(suite):
    """MB of each node."""
    found = {}
    for name, process in suite.processes.items():
        pages = int(Path(f'/proc/{process.pid}/statm').read_text().split()[1])
        found[name] = pages * os.sysconf('SC_PAGE_SIZE') / 1e6
    return found


@pytest.mark.slow
@pytest.mark.timeout(MINUTES * 60 + 300)
def test_memory_does_not_grow_under_mixed_requests(fresh_suite, quick):
    suite = fresh_suite()
    rng = random.Random(8)
    classify = suite.client.node.create_client(ClassifyPose, 'classify_pose', qos_profile=SERVICES)
    codes = []

    def ask(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            name, seed = rng.choice(PARTS), rng.randrange(10**9)
            kind = rng.randrange(8)
            if kind < 3:  # new drops
                answer = suite.client.ask(name, rng.randint(1, 60), seed=[seed], conditions=quick)
            elif kind == 3:
                answer = suite.client.ask(name, 1, only_known=True, conditions=quick)
            elif kind == 4:
                answer = suite.client.ask(name, method='rolling')
            elif kind == 5:
                answer = suite.client.ask(rng.choice(['', 'nothing', 'x' * 300]), 5)
            elif kind == 6:
                drop = suite.client.dropping(name, 20_000, seed=seed, conditions=quick)
                drop.cancel()
                suite.client.wait(lambda d=drop: d.done, 'end of the goal')
                answer = drop.result
            else:
                request = ClassifyPose.Request(part=name, orientation=Quaternion(w=1.0))
                answer = suite.client.call(classify, request)
            codes.append(answer.status.code)

    ask(MINUTES * 60 / 3)
    before = resident(suite)
    ask(MINUTES * 60 * 2 / 3)
    after = resident(suite)
    assert suite.alive
    assert set(codes) >= {Status.OK, Status.UNKNOWN_PART, Status.CANCELED}
    assert Status.FAILED not in codes
    for name, mb in after.items():
        assert mb < 1.1 * before[name], (before, after, len(codes))
