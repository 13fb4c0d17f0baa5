"""A studio without a browser: its rooms, its server, and a part that is opened already."""

import asyncio
import json
import threading
from contextlib import asynccontextmanager

import pytest
from aiohttp.test_utils import TestClient, TestServer

from resting_aspects_ros.simulation.workers import LocalWorkers
from resting_aspects_ros.studio.opening import open_part
from resting_aspects_ros.studio.room import Room
from resting_aspects_ros.studio.rows import Source
from resting_aspects_ros.studio.server import Studio, make_app

TIMEOUT = 600.0


class Shown:
    """What a room publishes; `wait` returns the first message of a topic that fulfils a test."""

    def __init__(self):
        self.messages = []
        self._changed = threading.Condition()

    def __call__(self, topic, message):
        with self._changed:
            self.messages.append((topic, message))
            self._changed.notify_all()

    def of(self, topic):
        with self._changed:
            return [message for name, message in self.messages if name == topic]

    def wait(self, topic, good=lambda message: True, after=0):
        def found():
            return [m for name, m in self.messages[after:] if name == topic and good(m)]

        with self._changed:
            assert self._changed.wait_for(found, TIMEOUT), topic
            return found()[0]

    @property
    def count(self):
        with self._changed:
            return len(self.messages)


class InThisProcess:
    """Opens parts without a process, which takes seconds to start."""

    def __init__(self):
        self.known = {}

    def open(self, source, step, stopped):
        if source not in self.known:
            self.known[source] = open_part(source, step)
        return self.known[source]

    def prepare(self):
        pass

    def end(self):
        pass


@pytest.fixture(scope='session')
def opener():
    return InThisProcess()


@pytest.fixture(scope='session')
def pool():
    workers = LocalWorkers(2)
    yield workers
    workers.stop()


@pytest.fixture
def shown():
    return Shown()


@pytest.fixture
def room(pool, opener, shown, tmp_path):
    (tmp_path / 'room').mkdir()
    made = Room(pool, opener, shown, tmp_path / 'room')
    yield made
    made.close()


@pytest.fixture
def bracket(room, shown):
    """The room with the L bracket, after its first 400 drops."""
    room.change('drops', 400)
    room.open(Source('l_bracket'))
    shown.wait('bars', lambda message: message.get('caption'))
    return room


@pytest.fixture(scope='session')
def served(opener):
    """Run an asynchronous function with a client and a studio."""

    @asynccontextmanager
    async def client_of(studio):
        server = TestServer(make_app(studio), host='127.0.0.1')
        async with TestClient(server) as client:
            studio.port = server.port
            yield client

    def run(task, **options):
        async def main():
            studio = Studio(['l_bracket'], **options)
            studio._tools = LocalWorkers(2), opener
            async with client_of(studio) as client:
                return await asyncio.wait_for(task(client, studio), TIMEOUT)

        return asyncio.run(main())

    return run


class Browser:
    """A WebSocket of the page."""

    def __init__(self, socket):
        self.socket = socket
        self.room = ''

    async def send(self, **message):
        await self.socket.send_str(json.dumps(message))

    async def wait(self, topic, good=lambda message: True):
        while True:
            message = json.loads((await self.socket.receive(TIMEOUT)).data)
            if message['topic'] == topic and good(message):
                return message


@pytest.fixture(scope='session')
def joined():
    """Open the socket of a studio, in a room."""

    async def join(client, studio, room=''):
        origin = f'http://127.0.0.1:{studio.port}'
        socket = await client.ws_connect(f'/{studio.token}/socket', headers={'Origin': origin})
        browser = Browser(socket)
        await browser.send(room=room)
        browser.room = (await browser.wait('room'))['room']
        return browser

    return join
