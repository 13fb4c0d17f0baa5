"""Only the page itself reaches the server: the rules of docs/how_to/studio.md."""

import re

import pytest
from aiohttp import WSServerHandshakeError

from resting_aspects_ros.studio import server
from resting_aspects_ros.studio.server import Studio

PATHS = [
    'static/..%2f..%2f..%2fetc%2fpasswd',
    'static/page.html',
    'file/x/report.html',
    'part/x/first',
]


def test_token_is_new_and_needed_and_nothing_else_is_served(served):
    assert Studio().token != Studio().token

    async def task(site):
        good = await site.get()
        assert 'How does your part lie?' in await good.text()
        assert 'Set-Cookie' not in good.headers
        paths = [f'{site.path}x/', f'{site.path[:-1]}/', '/', '/favicon.ico']
        paths += [f'{site.path}/{path}' for path in PATHS]
        root = site.client.make_url('')  # the path is sent as it is written
        addresses = [type(root)(f'{root}{path}', encoded=True) for path in paths]
        return {(await site.client.session.get(address)).status for address in addresses}

    assert served(task) <= {404, 405}


HEADERS = [
    ({'Host': 'evil.example'}, 403),
    ({'Host': '127.0.0.1:1'}, 403),
    ({'Host': '[::1]:{port}'}, 200),
    ({'Origin': 'http://evil.example'}, 403),
    ({'Origin': 'null'}, 403),
    ({'Origin': 'http://127.0.0.1:{port}'}, 200),
    ({'Sec-Fetch-Site': 'same-site', 'Sec-Fetch-Mode': 'cors'}, 403),
    ({'Sec-Fetch-Site': 'cross-site', 'Sec-Fetch-Mode': 'navigate'}, 200),
    ({'Sec-Fetch-Site': 'same-origin'}, 200),
]


def test_headers_of_other_sites_are_refused(served):
    async def task(site):
        found = []
        for headers, _ in HEADERS:
            port = site.studio.port
            sent = {name: value.format(port=port) for name, value in headers.items()}
            found.append((headers, (await site.get(headers=sent)).status))
        # The socket needs the origin of the page.
        for site.origin in ({}, {'Origin': 'null'}):
            with pytest.raises(WSServerHandshakeError) as refused:
                await site.connect()
            assert refused.value.status == 403
        return found

    assert served(task) == HEADERS


def test_page_has_a_closed_policy(served):
    async def task(site):
        page, script = await site.get(), await site.get('static/studio.js')
        for each in (page, script):
            assert each.headers['X-Content-Type-Options'] == 'nosniff'
            assert each.headers['Referrer-Policy'] == 'no-referrer'
            assert each.headers['X-Frame-Options'] == 'DENY'
        return await page.text(), page.headers['Content-Security-Policy']

    text, policy = served(task)
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    scripts = policy.partition('script-src ')[2].partition(';')[0]
    nonce = re.fullmatch(r"'self' 'nonce-([\w-]{20,})'", scripts)[1]
    assert text.count(f'nonce="{nonce}"') == text.count('<script') - text.count('src="static')
    assert not re.search('https?://', text)


@pytest.mark.parametrize(
    ('name', 'shown'),
    [
        ('C:\\parts\\../my part.stl', 'my part.stl'),
        ('<img src=x onerror=alert(1)>.stl', '<img src=x onerror=alert(1)>.stl'),
        ('a\x00b\n\x1b[31m.stl', ''),
        ('x' * 3000 + '.stl', ''),
    ],
)
def test_upload_is_stored_below_our_own_name(served, name, shown):
    async def task(site):
        tab = await site.join()
        answer = await site.upload(tab, name, b'solid nothing')
        if answer.status != 200:
            assert site.files() == []
            return await answer.text()
        assert site.files() == ['part.stl']
        return (await tab.wait('problem', lambda message: message['text']))['text']

    problem = served(task)
    assert '\n' not in problem
    assert '\x1b' not in problem
    assert shown in problem


def test_upload_of_another_kind_or_size_leaves_no_file(served, monkeypatch):
    monkeypatch.setattr(server, 'MAX_UPLOAD', 1000)

    async def chunks():
        for _ in range(5):
            yield b'x' * 500

    async def task(site):
        tab = await site.join()
        for name in ('part', 'part.stl.html'):
            answer = await site.upload(tab, name, b'x')
            assert answer.status == 415
            assert '.step' in await answer.text()
        for data in (b'x' * 2000, chunks()):
            assert (await site.upload(tab, 'part.stl', data)).status == 413
        return site.files()

    assert served(task) == []


MESSAGES = [
    'null',
    '{',
    '{"set": "condition.friction", "to": "much"}',
    '{"set": "condition.friction", "to": -1}',
    '{"set": "condition.friction", "to": {"a": []}}',
    '{"set": "condition.__class__", "to": 1}',
    '{"set": "surroundings", "to": "/etc/passwd.yaml"}',
    '{"set": "drops", "to": 1000000000000}',
    '{"set": "drops", "to": "٣"}',
    '{"set": "trap.add", "to": "cut_out"}',
    '{"set": "trap.remove", "to": 0}',
    '{"set": "trap.all", "to": "[{}]"}',
    '{"again": "unit", "to": "furlong"}',
    '{"do": "rm"}',
    '[' * 5000,
]


@pytest.mark.slow
def test_wrong_message_is_one_sentence(served):
    async def task(site):
        tab = await site.join()
        seat = site.studio.seats[tab.room]
        before = seat.room.settings
        for number, message in enumerate(MESSAGES):
            await tab.socket.send_str(message)
            problem = (await tab.wait('problem', lambda found: found['text']))['text']
            assert '\n' not in problem
            assert len(problem) < 500
            # The room lives on. A problem is published again after a good change.
            await tab.send(set='live', to=True, number=number)
            await tab.answer(number)
            seat.latest.pop('problem')
        return seat.room.settings == before

    assert served(task)


def test_large_message_ends_the_socket_but_not_the_room(served):
    async def task(site):
        tab = await site.join()
        await tab.send(set='x' * (1 << 17))
        await tab.closed()
        return (await site.join(tab.room)).room == tab.room

    assert served(task)


def test_flood_of_messages_makes_no_queue_and_the_room_lives_on(served):
    async def task(site):
        tab = await site.join()
        for k in range(2000):
            await tab.send(set='condition.friction', to=k / 4000, number=k)
        values = await tab.answer(1999)
        assert len(site.studio.seats[tab.room].waiting) < 30
        return values['condition.friction']

    assert served(task) == '0.49975'
