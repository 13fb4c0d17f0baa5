"""The connection of a thread to Bullet, whose worlds all use it."""

import threading
import weakref

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.simulation.silenced_stderr import silenced_stderr

with silenced_stderr():  # pybullet prints its build time on import, in every process
    import pybullet

__all__ = ['empty_client', 'pybullet']


def empty_client() -> int:
    """Return the thread's Bullet client with an empty world; connecting again would take 5 ms."""
    if not hasattr(_thread_data, 'client'):
        _thread_data.client = _Client()
    number = _thread_data.client.number
    pybullet.resetSimulation(physicsClientId=number)
    return number


class _Client:
    """A connection to Bullet that closes when its thread ends."""

    def __init__(self) -> None:
        self.number: int = pybullet.connect(pybullet.DIRECT)
        if self.number < 0:
            raise EngineError('Bullet cannot create another world in this process')
        weakref.finalize(self, pybullet.disconnect, self.number)


class _PerThread(threading.local):
    client: _Client


_thread_data = _PerThread()
