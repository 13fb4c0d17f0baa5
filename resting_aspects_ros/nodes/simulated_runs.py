"""The runs of which a simulator has published drops."""

from collections import OrderedDict

from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.nodes.convert import run_from
from resting_aspects_ros.nodes.requests import BusyError

# Descriptions of so many runs are kept, to publish drops of them again.
RUNS_KEPT = 10_000


class SimulatedRuns:
    """Knows how each run is described, and how far those are that are under way."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, RunDescription] = OrderedDict()
        self._published: dict[str, int] = {}  # run under way -> index after its last drop so far

    def find(self, goal: DropPart.Goal, asked: RunDescription) -> RunDescription:
        """The run that the drops of a goal belong to.

        Raises InvalidValueError if they are not of that run, BusyError if they are yet to come.
        """
        run = self._runs.get(asked.run_id) or _described(goal, asked)
        if run.sequence() != asked.sequence():
            raise InvalidValueError(
                f'run {run.run_id} is of {run.part} under other conditions, of another seed, of '
                'another version of the part, or made with another engine or suite: only its own '
                'drops can be published again'
            )
        if asked.end > self._published.get(run.run_id, asked.end):
            raise BusyError(
                f'run {run.run_id} is under way, its drops from '
                f'{self._published[run.run_id]} on are yet to come'
            )
        self._runs[run.run_id] = run
        while len(self._runs) > RUNS_KEPT:
            self._runs.popitem(last=False)
        return run

    def reached(self, run: RunDescription, end: int) -> None:
        """A run is under way, and its drops before ``end`` are published."""
        self._published[run.run_id] = end

    def over(self, run: RunDescription) -> None:
        """A run is under way no more."""
        del self._published[run.run_id]


def _described(goal: DropPart.Goal, asked: RunDescription) -> RunDescription:
    """The run as who asks describes it; else the drops that are asked for are all of it."""
    if not goal.run:
        return asked
    run = run_from(goal.run[0])
    if run.run_id != goal.run_id:
        raise InvalidValueError(
            f'run.run_id is {run.run_id!r}, allowed is run_id: {goal.run_id!r}'
        )
    return run
