"""The runs of which a simulator has published drops."""

from collections import OrderedDict

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.nodes.requests import BusyError, NotAvailableError

# Descriptions of so many runs are kept, to publish drops of them again.
RUNS_KEPT = 10_000


class SimulatedRuns:
    """Knows how each run is described, and how far each run under way is."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, RunDescription] = OrderedDict()
        self._published: dict[str, int] = {}  # run under way -> index after its last drop so far

    def find(self, asked: RunDescription) -> RunDescription:
        """Return the run of which drops are asked for again.

        Raises NotAvailableError if this simulator has not made it, InvalidValueError if the drops
        are not of that run, BusyError if it has not come to them yet.
        """
        run = self._runs.get(asked.run_id)
        if run is None:
            raise NotAvailableError(
                f'run {asked.run_id} was not made by this simulator, which was perhaps started '
                'again since'
            )
        if run.sequence() != asked.sequence():
            raise InvalidValueError(
                f'run {run.run_id} is of {run.part} under other conditions, of another seed or '
                'of another version of the part: only its own drops can be published again'
            )
        if asked.end > self._published.get(run.run_id, asked.end):
            raise BusyError(
                f'run {run.run_id} is under way and has not come to its drops from '
                f'{self._published[run.run_id]} on'
            )
        return run

    def begin(self, run: RunDescription) -> None:
        """A run begins."""
        self._runs[run.run_id] = run
        self._published[run.run_id] = run.first_drop
        while len(self._runs) > RUNS_KEPT:
            self._runs.popitem(last=False)

    def reach(self, run: RunDescription, end: int) -> None:
        """The drops of a run before ``end`` are published."""
        self._published[run.run_id] = end

    def end(self, run: RunDescription) -> None:
        """A run is under way no more."""
        del self._published[run.run_id]
