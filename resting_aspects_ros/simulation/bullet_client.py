"""The connection of a thread to Bullet, whose worlds all use it, and shapes of convex pieces."""

import os
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.rotations import Array


@contextmanager
def _silenced_stderr() -> Iterator[None]:
    """Discard standard error, including the output of C code, which bypasses sys.stderr."""
    sys.stderr.flush()
    saved = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(null)


with _silenced_stderr():  # pybullet prints its build time on import, in every process
    import pybullet

__all__ = ['compound', 'empty_client', 'pybullet']


def empty_client() -> int:
    """Return the thread's Bullet client with an empty world; connecting again would take 5 ms."""
    if not hasattr(_thread_data, 'client'):
        _thread_data.client = _Client()
    number = _thread_data.client.number
    pybullet.resetSimulation(physicsClientId=number)
    return number


def compound(pieces: tuple[Array, ...], client: int) -> int:
    """Return a shape of convex pieces, each given by its corners (n, 3).

    PyBullet reads a compound of more than one set of corners only from a file.
    """
    with tempfile.NamedTemporaryFile('w', suffix='.obj') as file:
        file.write(_obj_text(pieces))
        file.flush()
        shape: int = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, fileName=file.name, physicsClientId=client
        )
    if shape < 0:
        raise EngineError('Bullet cannot read convex pieces')
    return shape


def _obj_text(pieces: tuple[Array, ...]) -> str:
    """Return the content of an OBJ file with each piece as an object.

    The triangles only name all corners: Bullet makes the convex hull of each object.
    """
    lines, first = [], 1
    for k, corners in enumerate(pieces):
        n = len(corners)
        lines.append(f'o {k}')
        lines += [f'v {x!r} {y!r} {z!r}' for x, y, z in corners.tolist()]
        lines += [f'f {first + i} {first + (i + 1) % n} {first + (i + 2) % n}' for i in range(n)]
        first += n
    return '\n'.join(lines) + '\n'


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
