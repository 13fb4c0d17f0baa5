"""Tabs keep their rooms over a reload, and the server ends everything it started."""

import asyncio
import threading

from resting_aspects_ros.studio.server import ROOM_LIFE, Studio


def test_reload_restores_the_room_and_its_settings(served, joined):
    async def task(client, studio):
        first = await joined(client, studio)
        await first.send(example='l_bracket')
        await first.wait('bars', lambda message: message.get('caption'))
        await first.send(set='condition.friction', to='0.4', number=1)
        await first.wait('values', lambda message: message.get('number') == 1)
        await first.socket.close()
        again = await joined(client, studio, first.room)
        found = {}
        while not {'part', 'scene', 'values', 'bars', 'aspects'} <= set(found):
            message = await again.socket.receive_json()
            found[message['topic']] = message
        return first.room == again.room, found

    same, found = served(task)
    assert same
    assert found['values']['values']['condition.friction'] == '0.4'
    assert found['part']['name'] == 'l_bracket'


def test_window_that_copies_a_key_gets_its_own_room(served, joined):
    now = [0.0]

    def clock():
        now[0] += 0.3
        return now[0]

    async def task(client, studio):
        first = await joined(client, studio)
        second = await joined(client, studio, first.room)
        await first.send(set='condition.friction', to='0.4', number=1)
        await second.send(set='condition.friction', to='0.6', number=1)
        values = [
            await each.wait('values', lambda message: message.get('number') == 1)
            for each in (first, second)
        ]
        return first.room, second.room, [each['values']['condition.friction'] for each in values]

    one, other, frictions = served(task, clock=clock)
    assert one != other
    assert frictions == ['0.4', '0.6']


def test_room_ends_some_time_after_its_tab(served, joined):
    now = [0.0]

    async def task(client, studio):
        browser = await joined(client, studio)
        seat = studio.seats[browser.room]
        await browser.socket.close()
        while seat.socket is not None:
            await asyncio.sleep(0)
        now[0] = ROOM_LIFE - 1
        await studio.end_left_rooms()
        assert browser.room in studio.seats
        now[0] = ROOM_LIFE + 1
        await studio.end_left_rooms()
        return browser.room in studio.seats, seat.room.folder.exists()

    assert served(task, clock=lambda: now[0]) == (False, False)


def test_end_leaves_no_thread_and_no_file(served, joined):
    before = set(threading.enumerate())
    folders = []

    async def task(client, studio):
        folders.append(studio.folder)
        await joined(client, studio)
        await joined(client, studio)

    served(task)
    left = [t for t in threading.enumerate() if t not in before and t.name != 'asyncio_0']
    assert not [t for t in left if t.name in ('room', 'opening') or t.name.startswith('drops')]
    assert not folders[0].exists()


def test_tab_is_told_that_the_server_ends(served, joined):
    async def task(client, studio):
        browser = await joined(client, studio)
        await studio.close_sockets()
        message = None
        while message is None or not browser.socket.closed:
            message = await browser.socket.receive()
        return browser.socket.close_code

    assert served(task) == 1001


def test_download_is_an_attachment(served, joined):
    async def task(client, studio):
        browser = await joined(client, studio)
        address = f'/{studio.token}/file/{browser.room}/distribution.json'
        missing = await client.get(address)
        await browser.send(example='l_bracket')
        await browser.wait('bars', lambda message: message.get('caption'))
        found = await client.get(address)
        return missing.status, await missing.text(), found.status, found.headers

    status, text, good, headers = served(task)
    assert (status, good) == (409, 200)
    assert 'missing part' in text
    assert headers['Content-Disposition'].startswith('attachment')
    assert 'sandbox' in headers['Content-Security-Policy']


def test_at_most_some_rooms(served, joined, monkeypatch):
    from resting_aspects_ros.studio import server

    monkeypatch.setattr(server, 'MAX_ROOMS', 1)

    async def task(client, studio):
        await joined(client, studio)
        origin = f'http://127.0.0.1:{studio.port}'
        socket = await client.ws_connect(f'/{studio.token}/socket', headers={'Origin': origin})
        await socket.send_str('{"room": ""}')
        return await socket.receive_json()

    assert 'close one' in served(task)['text']


def test_each_studio_has_its_own_folder():
    one, other = Studio([]), Studio([])
    try:
        assert one.folder != other.folder
        assert one.folder.stat().st_mode & 0o077 == 0
    finally:
        for each in (one, other):
            each.folder.rmdir()
