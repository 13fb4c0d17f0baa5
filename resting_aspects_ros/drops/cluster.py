"""Drops on a Dask cluster: the one file that imports distributed, which need not be installed."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

from resting_aspects_ros.core.errors import EngineError, InvalidValueError

# For the scheduler to answer, and then for a worker to be there, s.
PATIENCE = 4.0
# What the poses depend on, beside the job: of other versions they need not be the same.
PACKAGES = ('resting_aspects_ros', 'pybullet', 'numpy', 'scipy')

T = TypeVar('T')


class ClusterWorkers:
    """The workers of a Dask cluster, as many as there are at any time: Workers of a campaign.

    A worker that dies is seen to by the scheduler, which gives its chunks to others. If there are
    none left, the drops wait for new ones.

    scheduler : str
        Its address, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    InvalidValueError
        If distributed is not installed, or if there is no scheduler with workers of the versions
        that are here.
    """

    def __init__(self, scheduler: str) -> None:
        self._client = _connect(scheduler)
        try:
            self._versions = _versions_everywhere(self._client, scheduler)
        except BaseException:
            self.stop()
            raise
        self._count = self._counted_for = 0
        # Not pure: what failed for somebody else is no answer.
        self._executor = _LikeHere(self._client.get_executor(pure=False), self._versions)

    @property
    def executor(self) -> Executor:
        """Of the whole cluster."""
        return self._executor

    def lookahead(self) -> int:
        """Two chunks for each worker that is there now."""
        # To count takes a word with the scheduler, which not every chunk must wait for.
        if self._counted_for == 0:
            self._count = self._counted_for = max(1, len(self._client.nthreads()))
        self._counted_for -= 1
        return 2 * self._count

    def deaths(self, error: Exception) -> int:
        """Workers that died with the same chunk one after the other, until Dask gave it up."""
        from distributed.scheduler import KilledWorker

        return error.allowed_failures + 1 if isinstance(error, KilledWorker) else 0

    def replace(self, broken: Executor) -> None:
        """Nothing: an executor of a cluster does not break with its workers."""

    def stop(self) -> None:
        """Leave the cluster, which cancels what has not begun."""
        self._client.close(timeout=PATIENCE)


class _LikeHere(Executor):
    """The cluster's executor, for work that is to be done with the versions that are here."""

    def __init__(self, executor: Executor, versions: Mapping[str, str | None]) -> None:
        self._executor = executor
        self._versions = versions

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> 'Future[T]':
        return self._executor.submit(_do_like, self._versions, fn, *args, **kwargs)


def _do_like(
    there: Mapping[str, str | None], fn: Callable[..., T], *args: Any, **kwargs: Any
) -> T:
    """Do something on a worker, which may have come after the others were looked at."""
    from distributed import get_worker
    from distributed.versions import get_versions

    if difference := _difference(get_versions(PACKAGES)['packages'], there):
        raise EngineError(f'the worker {get_worker().address} {difference}')
    return fn(*args, **kwargs)


def _difference(versions: Mapping[str, str | None], wanted: Mapping[str, str | None]) -> str:
    """The first package that is of another version, in words; empty if there is none."""
    for name in PACKAGES:
        if versions[name] != wanted[name]:
            has = f'{name} {versions[name]}' if versions[name] else f'no {name}'
            return f'has {has}, here it is {wanted[name]}'
    return ''


def _connect(scheduler: str) -> Any:
    """A client of a scheduler that has workers; raises InvalidValueError."""
    try:
        from distributed import Client
    except ImportError:
        raise InvalidValueError(
            f'scheduler is {scheduler!r}, which needs Dask: pip install distributed'
        ) from None
    # What goes wrong is said in our words.
    for name in ('distributed', 'distributed.client', 'tornado.application'):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        # A client that fails to connect to what is no scheduler leaves a traceback; this does not.
        role = asyncio.run(asyncio.wait_for(_role(scheduler), PATIENCE))
        if role != 'Scheduler':
            raise InvalidValueError(f'this is a {role.lower()}')
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # noqa: BLE001 - it may be a web server, or nobody, that answers
        reason = str(error) or f'nobody answers within {PATIENCE:g} s'
        raise InvalidValueError(
            f'scheduler is {scheduler!r}, allowed is the address of a Dask scheduler: {reason}'
        ) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except asyncio.TimeoutError:
        client.close(timeout=PATIENCE)
        raise InvalidValueError(
            f'scheduler is {scheduler!r}, allowed is one that has workers: none came within '
            f'{PATIENCE:g} s'
        ) from None
    return client


async def _role(address: str) -> str:
    """What answers at an address: Scheduler, Worker or Nanny."""
    from distributed import Security, rpc

    credentials = Security().get_connection_args('client')
    async with rpc(address, connection_args=credentials) as server:
        return str((await server.identity())['type'])


def _versions_everywhere(client: Any, scheduler: str) -> Mapping[str, str | None]:
    """The versions that are here; InvalidValueError if they are others somewhere."""
    found = client.get_versions(packages=PACKAGES)
    wanted: Mapping[str, str | None] = found['client']['packages']
    # The scheduler reads what is submitted, too.
    for where, its in (('the scheduler', found['scheduler']), *found['workers'].items()):
        if difference := _difference(its['packages'], wanted):
            raise InvalidValueError(
                f'scheduler is {scheduler!r}, allowed is one of the versions that are here: '
                f'{where} {difference}'
            )
    return wanted
