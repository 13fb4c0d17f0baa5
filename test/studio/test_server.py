"""Tabs keep their rooms over a reload, and the server ends everything it started."""

import argparse
import asyncio
import os
import signal
import threading
import urllib.request
import webbrowser
from itertools import count
from pathlib import Path

import pytest
from aiohttp import ClientSession

from resting_aspects_ros.cli.verbs.studio import run
from resting_aspects_ros.simulation.workers import LocalWorkers
from resting_aspects_ros.studio.server import ROOM_LIFE, Studio, serve


def test_page_is_served_to_this_computer_while_a_browser_in_the_terminal_runs(monkeypatch):
    pages = []

    def browse(address):
        direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with direct.open(address, timeout=10) as page:
                pages.append(page.status)
            # Another address of this computer, at which only a server for all would listen.
            with pytest.raises(OSError, match='refused'):
                direct.open(address.replace('127.0.0.1', '127.0.0.2'), timeout=10)
        finally:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(webbrowser, 'open', browse)
    monkeypatch.setattr(Studio, 'tools', lambda _: None)
    assert run(argparse.Namespace(part='', port=0, no_browser=False)) == 0
    assert pages == [200]


def test_upload_that_fails_is_removed_and_is_one_sentence(served, monkeypatch):
    def full(*_):
        raise OSError(28, 'No space left on device')

    async def task(site):
        tab = await site.join()
        monkeypatch.setattr(Path, 'open', full)
        answer = await site.upload(tab, 'part.stl', b'x')
        left = list(site.studio.seats[tab.room].room.folder.iterdir())
        return answer.status, await answer.text(), left

    text = 'part.stl was not stored: No space left on device'
    assert served(task) == (507, text, [])


def test_reload_restores_the_room_and_its_settings(served):
    async def task(site):
        first = await site.join()
        path = f'file/{first.room}/distribution.json'
        missing = await site.get(path)
        assert missing.status == 409
        assert 'missing part' in await missing.text()
        await first.send(set='drops', to=400)
        await first.send(example='l_bracket')
        await first.wait('bars', lambda message: message.get('caption'))
        await first.send(set='condition.friction', to='0.4', number=1)
        await first.answer(1)
        file = await site.get(path)
        assert file.headers['Content-Disposition'].startswith('attachment')
        assert 'sandbox' in file.headers['Content-Security-Policy']
        await first.socket.close()
        again = await site.join(first.room)
        assert first.room == again.room
        found = {}
        while not {'part', 'scene', 'values', 'bars', 'aspects'} <= set(found):
            message = await again.socket.receive_json()
            found[message['topic']] = message
        return found

    found = served(task)
    assert found['values']['values']['condition.friction'] == '0.4'
    assert found['part']['name'] == 'l_bracket'


def test_window_that_copies_a_key_gets_its_own_room(served):
    async def task(site):
        first = await site.join()
        second = await site.join(first.room)
        assert first.room != second.room
        for tab, friction in ((first, '0.4'), (second, '0.6')):
            await tab.send(set='condition.friction', to=friction, number=1)
        return [(await tab.answer(1))['condition.friction'] for tab in (first, second)]

    assert served(task, clock=count(step=0.3).__next__) == ['0.4', '0.6']


def test_room_ends_some_time_after_its_tab(served):
    now = [0.0]

    async def task(site):
        tab = await site.join()
        seats = site.studio.seats
        seat = seats[tab.room]
        await tab.socket.close()
        while seat.socket is not None:
            await asyncio.sleep(0)
        now[0] = ROOM_LIFE - 1
        await site.studio.end_left_rooms()
        assert tab.room in seats
        now[0] = ROOM_LIFE + 1
        await site.studio.end_left_rooms()
        return tab.room in seats, seat.room.folder.exists()

    assert served(task, clock=lambda: now[0]) == (False, False)


def test_end_tells_the_tab_and_leaves_no_thread_and_no_file(served):
    before, studios = set(threading.enumerate()), []

    async def task(site):
        studios.append(site.studio)
        assert site.studio.folder.stat().st_mode & 0o077 == 0
        tab = await site.join()
        await tab.send(set='drops', to=2_000_000)
        await tab.send(example='tetrahedron')
        await tab.wait('progress', lambda message: message['text'])
        await site.studio.close_sockets()
        assert await tab.closed() == 1001

    served(task)
    left = [thread.name for thread in threading.enumerate() if thread not in before]
    assert not [name for name in left if name.startswith(('room', 'opening', 'drops'))]
    assert not studios[0].folder.exists()


def test_room_of_a_tab_that_is_closed_while_it_is_made_has_no_socket(opener, monkeypatch):
    async def main():
        studio, over = Studio(), asyncio.Event()
        studio._tools = LocalWorkers(2), opener
        make, started, closed = studio._new_seat, asyncio.Event(), asyncio.Event()
        address = asyncio.get_running_loop().create_future()

        async def slow():
            started.set()
            await closed.wait()
            return await make()

        monkeypatch.setattr(studio, '_new_seat', slow)
        server = asyncio.create_task(serve(studio, 0, address.set_result, over.is_set))
        async with ClientSession() as session:
            url = f'{await address}socket'
            socket = await session.ws_connect(url, origin=f'http://127.0.0.1:{studio.port}')
            await socket.send_str('{"room": ""}')
            await started.wait()
        for _ in range(20):  # turns in which the server reads the end of the connection
            await asyncio.sleep(0)
        closed.set()
        while not any(seat.left for seat in studio.seats.values()):  # when the tab has left
            await asyncio.sleep(0.01)
        left = [seat.socket for seat in studio.seats.values()]
        over.set()
        await server
        return left

    assert asyncio.run(asyncio.wait_for(main(), 600)) == [None]
