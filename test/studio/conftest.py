"""A studio without a browser: its rooms, its server, and a part that is opened already."""

import asyncio
import functools
import json
import threading
from types import SimpleNamespace

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

    def of(self, topic, after=0):
        return [message for name, message in self.messages[after:] if name == topic]

    def wait(self, topic, good=lambda message: True, after=0):
        def found():
            return [message for message in self.of(topic, after) if good(message)]

        with self._changed:
            assert self._changed.wait_for(found, TIMEOUT), topic
            return found()[0]


@pytest.fixture(scope='session')
def opener():
    """Opens parts without a process, which takes seconds to start."""
    known = functools.cache(open_part)
    return SimpleNamespace(open=lambda source, *_: known(source), end=lambda: None)


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


class Site:
    """What a browser sends to a studio, and to its WebSocket."""

    def __init__(self, client, studio):
        self.client, self.studio = client, studio
        self.path = f'/{studio.token}'
        self.origin = {'Origin': f'http://127.0.0.1:{studio.port}'}

    async def get(self, path='', **options):
        return await self.client.get(f'{self.path}/{path}', **options)

    async def upload(self, tab, name, data):
        address = f'{self.path}/part/{tab.room}/first'
        return await self.client.put(address, params={'name': name}, data=data)

    async def connect(self, room=''):
        socket = await self.client.ws_connect(f'{self.path}/socket', headers=self.origin)
        await socket.send_str(json.dumps({'room': room}))
        return socket

    async def join(self, room=''):
        tab = Tab(await self.connect(room))
        tab.room = (await tab.wait('room'))['room']
        return tab

    def files(self):
        return [path.name for path in self.studio.folder.rglob('*') if path.is_file()]


class Tab:
    """A WebSocket of the page, in a room."""

    def __init__(self, socket):
        self.socket = socket

    async def send(self, **message):
        await self.socket.send_str(json.dumps(message))

    async def wait(self, topic, good=lambda message: True):
        while True:
            message = json.loads((await self.socket.receive(TIMEOUT)).data)
            if message['topic'] == topic and good(message):
                return message

    async def answer(self, number):
        """Return the values of the controls after a change with a number."""
        found = await self.wait('values', lambda message: message.get('number') == number)
        return found['values']

    async def closed(self):
        while not self.socket.closed:
            await self.socket.receive(TIMEOUT)
        return self.socket.close_code


@pytest.fixture(scope='session')
def served(opener):
    """Run an asynchronous function with the site of a studio."""

    def run(task, **options):
        async def main():
            studio = Studio(**options)
            studio._tools = LocalWorkers(2), opener
            server = TestServer(make_app(studio), host='127.0.0.1')
            async with TestClient(server) as client:
                studio.port = server.port
                return await asyncio.wait_for(task(Site(client, studio)), TIMEOUT)

        return asyncio.run(main())

    return run
