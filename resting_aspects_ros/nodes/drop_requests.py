"""How the classifier gets a part dropped: one goal for all who ask for the same drops at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.errors import EngineError, RestingAspectsError
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.nodes.convert import conditions_msg
from resting_aspects_ros.nodes.drop_goals import ASK_PERIOD, LOOK_PERIOD, drop_result
from resting_aspects_ros.nodes.earlier_runs import EarlierRuns
from resting_aspects_ros.nodes.interface import ACTION_SERVICES, DROP_PART
from resting_aspects_ros.nodes.requests import CanceledError, NotAvailableError, status_error
from resting_aspects_ros.nodes.waiting import wait_for
from resting_aspects_ros.nodes.words import of_run

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.run_accounts import RunAccount

# A simulator that is started together with the node may come this long after it, s. Later it is
# there, or nobody has started it: to be found takes it no longer than DISCOVERY, s.
STARTING = 10.0
DISCOVERY = 2.0
SERVER_PERIOD = 0.1
# All batches were sent before the goal's result; so long they have to arrive, or to be asked
# for again, s.
BATCHES_TIMEOUT = 120.0


@dataclass(frozen=True)
class DropSpec:
    """Drops that are wanted."""

    part: str
    conditions: DropConditions
    drops: int
    precision: float
    seed: int


class DropRequests:
    """Sends drop_part goals and waits until their poses have been counted.

    A run that somebody else asked for, or that was under way before this node was there, is
    waited for, and not made a second time.

    Parameters
    ----------
    over : gives for a run id the future of its account, done when the run is over
    under_way : gives the account of a run that will end with just these drops
    look_after : called often with the id of a run that is waited for, and with how long it may
        be silent, s
    """

    def __init__(
        self,
        node: Node,
        over: Callable[[str], Future],
        under_way: Callable[[DropSpec], 'RunAccount | None'],
        look_after: Callable[[str, float], None],
        earlier: EarlierRuns,
    ) -> None:
        self._node = node
        self._over = over
        self._find = under_way
        self._look_after = look_after
        self._earlier = earlier
        self._client = ActionClient(node, DropPart, DROP_PART, **ACTION_SERVICES)
        self._begun = time.monotonic()
        self._under_way: dict[DropSpec, Future] = {}

    def destroy(self) -> None:
        """End the action client."""
        self._client.destroy()

    def simulator_is_there(self) -> bool:
        """Whether a goal can be sent now."""
        return bool(self._client.server_is_ready())

    async def drop(self, spec: DropSpec) -> 'RunAccount':
        """The account of a run of these drops; raises what the simulator answers."""
        if spec in self._under_way:
            answer = await self._under_way[spec]
        else:
            joined = self._under_way[spec] = Future(executor=self._node.executor)
            try:
                answer = await self._run(spec)
            except RestingAspectsError as error:
                answer = error
            except Exception as error:
                joined.set_result(EngineError(f'unexpected: {error!r}'))
                raise
            finally:
                del self._under_way[spec]
            joined.set_result(answer)
        if isinstance(answer, RestingAspectsError):
            raise answer
        return answer

    async def _run(self, spec: DropSpec) -> 'RunAccount':
        await self.simulator()
        await self._earlier.wait()
        begun = self._find(spec)
        if begun is not None:
            return await self._follow(begun.run)
        goal = DropPart.Goal(
            part=spec.part,
            surface=spec.conditions.surface,
            conditions=[conditions_msg(spec.conditions)],
            drops=spec.drops,
            precision=spec.precision,
            seed=spec.seed,
        )
        result = await drop_result(self._node, self._client, goal)
        if result.status.code != Status.OK:
            raise status_error(result.status)
        over = self._over(result.run_id)
        if not await wait_for(self._node, over, BATCHES_TIMEOUT):
            raise EngineError(f'the poses of run {result.run_id} did not arrive')
        account: RunAccount = over.result()
        if account.problem:
            raise EngineError(account.problem)
        if result.log_error:
            account.note = f'not all of the run is recorded: {result.log_error}'
        return account

    async def _follow(self, run: RunDescription) -> 'RunAccount':
        """The account of a run of which this node has no goal."""
        over = self._over(run.run_id)
        while not await wait_for(self._node, over, LOOK_PERIOD):
            if not self.simulator_is_there():
                raise NotAvailableError(f'the simulator went away while it dropped {run.part}')
            self._look_after(run.run_id, ASK_PERIOD)
        account: RunAccount = over.result()
        if account.problem:
            raise EngineError(account.problem)
        if not account.reached:
            done = of_run(run, account.counted.drops)
            raise CanceledError(f'canceled, or broken off, after {done}; those are kept')
        return account

    async def simulator(self) -> None:
        """Wait until there is one; NotAvailableError if none comes."""
        never = Future(executor=self._node.executor)
        asked = time.monotonic()
        end = max(asked + DISCOVERY, self._begun + STARTING)
        while not self.simulator_is_there():
            if time.monotonic() >= end:
                raise NotAvailableError(
                    f'no drop_simulator answers on {self._node.resolve_service_name(DROP_PART)}, '
                    f'waited {end - asked:.0f} s: start drop_simulator'
                )
            await wait_for(self._node, never, SERVER_PERIOD)
