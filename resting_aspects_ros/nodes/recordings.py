"""What recorders say of the logs of runs, for who made the drops."""

import time
from collections import OrderedDict

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RecordedRun

from resting_aspects_ros.nodes.callbacks import subscribe
from resting_aspects_ros.nodes.interface import ALL_LATCHED, RECORDED_RUNS
from resting_aspects_ros.nodes.waiting import wait_for

# A recorder that is there has closed the log of a run so soon, s. One that is slow, or that waits
# for a classifier, costs a result this much, and is not waited for any longer.
TIMEOUT = 2.0
RUNS_KEPT = 1000


class Recordings:
    """Listens to recorded_runs."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._runs: OrderedDict[str, RecordedRun] = OrderedDict()
        self._news = Future()
        subscribe(node, RecordedRun, RECORDED_RUNS, self._recorded, ALL_LATCHED)

    async def note(self, result: DropPart.Result) -> None:
        """Say in the result of a run where its log is, and whether that has gone wrong."""
        end = time.monotonic() + TIMEOUT
        while not self._is_recorded(result) and (left := end - time.monotonic()) > 0:
            await wait_for(self._node, self._news, left)
        if (found := self._runs.get(result.run_id)) is not None:
            result.log, result.log_error = found.log, found.error

    def _is_recorded(self, result: DropPart.Result) -> bool:
        """Whether no more is to be heard of it."""
        topic = self._node.resolve_topic_name(RECORDED_RUNS)
        if not result.drops or not self._node.count_publishers(topic):
            return True
        found = self._runs.get(result.run_id)
        # After the last batch the disk can still be full: the end of a log takes room, too.
        return found is not None and (bool(found.error) or bool(found.whole))

    def _recorded(self, message: RecordedRun) -> None:
        self._runs[message.run_id] = message
        while len(self._runs) > RUNS_KEPT:
            self._runs.popitem(last=False)
        news, self._news = self._news, Future(executor=self._node.executor)
        news.set_result(None)
