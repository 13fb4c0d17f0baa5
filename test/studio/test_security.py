"""Only the page itself reaches the server: the rules of docs/how_to/studio.md."""

import asyncio
import json

import pytest
from aiohttp import WSServerHandshakeError

from resting_aspects_ros.studio import server
from resting_aspects_ros.studio.server import Studio, serve

PAGE = 'How does your part lie?'


def test_server_listens_on_this_computer_only(monkeypatch):
    hosts = []

    class Site:
        def __init__(self, _runner, host, _port):
            hosts.append(host)

        async def start(self):
            raise OSError(98, 'in use')

    monkeypatch.setattr(server.web, 'TCPSite', Site)
    with pytest.raises(OSError, match='in use'):
        asyncio.run(serve(Studio([]), 0, print, lambda: True))
    assert hosts == ['127.0.0.1']


PATHS = [
    'static/../server.py',
    'static/%2e%2e%2fserver.py',
    'static/..%2f..%2f..%2fetc%2fpasswd',
    'static/page.html',
    'file/x/report.html',
    'part/x/first',
]


def test_token_is_new_and_needed_and_nothing_else_is_served(served):
    assert Studio([]).token != Studio([]).token

    async def task(client, studio):
        good = await client.get(f'/{studio.token}/')
        assert PAGE in await good.text()
        assert 'Set-Cookie' not in good.headers
        paths = [f'{studio.token[:-1]}x/', f'{studio.token[:-1]}/', '', '/', 'favicon.ico']
        paths += [f'{studio.token}/{path}' for path in PATHS]
        root = client.make_url('/')  # the path is sent as it is written
        addresses = [type(root)(f'{root}{path}', encoded=True) for path in paths]
        return {(await client.session.get(address)).status for address in addresses}

    assert served(task) <= {404, 405}


HEADERS = [
    ({'Host': 'evil.example'}, 403),
    ({'Host': '127.0.0.1:1'}, 403),
    ({'Host': 'localhost:{port}'}, 200),
    ({'Host': '[::1]:{port}'}, 200),
    ({'Origin': 'http://evil.example'}, 403),
    ({'Origin': 'null'}, 403),
    ({'Origin': 'http://127.0.0.1:1'}, 403),
    ({'Origin': 'http://127.0.0.1:{port}'}, 200),
    ({'Sec-Fetch-Site': 'cross-site', 'Sec-Fetch-Mode': 'no-cors'}, 403),
    ({'Sec-Fetch-Site': 'same-site', 'Sec-Fetch-Mode': 'cors'}, 403),
    ({'Sec-Fetch-Site': 'cross-site', 'Sec-Fetch-Mode': 'navigate'}, 200),
    ({'Sec-Fetch-Site': 'same-origin'}, 200),
]


def test_headers_of_other_sites_are_refused(served):
    async def task(client, studio):
        found = []
        for headers, _ in HEADERS:
            sent = {name: value.format(port=studio.port) for name, value in headers.items()}
            answer = await client.get(f'/{studio.token}/', headers=sent)
            found.append((headers, answer.status))
        # The socket needs the origin of the page.
        for headers in ({}, {'Origin': 'http://evil.example'}, {'Origin': 'null'}):
            with pytest.raises(WSServerHandshakeError) as refused:
                await client.ws_connect(f'/{studio.token}/socket', headers=headers)
            assert refused.value.status == 403
        return found

    assert served(task) == HEADERS


def test_page_has_a_closed_policy(served):
    async def task(client, studio):
        page = await client.get(f'/{studio.token}/')
        script = await client.get(f'/{studio.token}/static/studio.js')
        return await page.text(), page.headers, script.headers

    text, page, script = served(task)
    policy = page['Content-Security-Policy']
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert 'unsafe-eval' not in policy
    script_source = policy.partition('script-src ')[2].partition(';')[0]
    assert 'unsafe-inline' not in script_source
    nonce = script_source.partition("'nonce-")[2].rstrip("'")
    assert len(nonce) >= 20
    assert text.count(f'nonce="{nonce}"') == text.count('<script') - text.count('src="static')
    for headers in (page, script):
        assert headers['X-Content-Type-Options'] == 'nosniff'
        assert headers['Referrer-Policy'] == 'no-referrer'
        assert headers['X-Frame-Options'] == 'DENY'
    assert 'http://' not in text.replace('http-equiv', '')
    assert 'https://' not in text


@pytest.mark.parametrize(
    ('name', 'shown'),
    [
        ('../../../etc/passwd.stl', 'passwd.stl'),
        ('C:\\parts\\my part.stl', 'my part.stl'),
        ('<img src=x onerror=alert(1)>.stl', '<img src=x onerror=alert(1)>.stl'),
        ('a\x00b\n\x1b[31m.stl', None),
        ('x' * 3000 + '.stl', None),
    ],
)
def test_upload_is_stored_below_our_own_name(served, joined, name, shown):
    async def task(client, studio):
        browser = await joined(client, studio)
        address = f'/{studio.token}/part/{browser.room}/first'
        answer = await client.put(address, params={'name': name}, data=b'solid nothing')
        files = [path.name for path in studio.folder.rglob('*') if path.is_file()]
        if answer.status != 200:
            assert files == []
            return await answer.text()
        assert files == ['part.stl']
        problem = await browser.wait('problem', lambda message: message['text'])
        await browser.send(set='live', to=True, number=1)  # the room lives on
        await browser.wait('values', lambda message: message.get('number') == 1)
        return problem['text']

    problem = served(task)
    assert '\n' not in problem
    assert '\x1b' not in problem
    if shown is not None:
        assert shown in problem


def test_upload_of_another_kind_or_size_leaves_no_file(served, joined, monkeypatch):
    monkeypatch.setattr(server, 'MAX_UPLOAD', 1000)

    async def chunks():
        for _ in range(5):
            yield b'x' * 500

    async def task(client, studio):
        browser = await joined(client, studio)
        address = f'/{studio.token}/part/{browser.room}/first'
        for name in ('part.exe', 'part', '', 'part.stl.html', 'part.svg'):
            answer = await client.put(address, params={'name': name}, data=b'x')
            assert answer.status == 415
            assert '.step' in await answer.text()
        for data in (b'x' * 2000, chunks()):
            answer = await client.put(address, params={'name': 'part.stl'}, data=data)
            assert answer.status == 413
        return [path for path in studio.folder.rglob('*') if path.is_file()]

    assert served(task) == []


MESSAGES = [
    '',
    'null',
    '{',
    '{"set": 3, "to": 4}',
    '{"set": "condition.friction", "to": "much"}',
    '{"set": "condition.friction", "to": -1}',
    '{"set": "condition.friction", "to": {"a": []}}',
    '{"set": "condition.__class__", "to": 1}',
    '{"set": "surface", "to": "../steel"}',
    '{"set": "surroundings", "to": "/etc/passwd.yaml"}',
    '{"set": "drops", "to": 1000000000000}',
    '{"set": "drops", "to": "٣"}',
    '{"set": "tab", "to": "os"}',
    '{"set": "pickable.1", "to": true}',
    '{"example": "../../x"}',
    '{"again": "unit", "to": "furlong"}',
    '{"again": "body", "to": ["mm"]}',
    '{"do": "rm"}',
    '[' * 5000,
]


@pytest.mark.slow
def test_wrong_message_is_one_sentence(served, joined):
    async def task(client, studio):
        browser = await joined(client, studio)
        before = studio.seats[browser.room].room.settings
        for number, message in enumerate(MESSAGES):
            await browser.socket.send_str(message)
            good = browser.wait('problem', lambda found: found['text'])
            problem = (await good)['text']
            assert '\n' not in problem
            assert len(problem) < 500
            # The room lives on. A problem is published again after a good change.
            await browser.send(set='live', to=True, number=number)
            await browser.wait('values', lambda found, n=number: found.get('number') == n)
            studio.seats[browser.room].latest.pop('problem')
        return studio.seats[browser.room].room.settings == before

    assert served(task)


def test_large_message_ends_the_socket_but_not_the_room(served, joined):
    async def task(client, studio):
        browser = await joined(client, studio)
        await browser.socket.send_str(json.dumps({'set': 'x' * (1 << 17)}))
        while not browser.socket.closed:
            await browser.socket.receive()
        again = await joined(client, studio, browser.room)
        return again.room == browser.room

    assert served(task)


def test_flood_of_messages_makes_no_queue_and_the_room_lives_on(served, joined):
    async def task(client, studio):
        browser = await joined(client, studio)
        for k in range(2000):
            await browser.send(set='condition.friction', to=k / 4000, number=k)
        found = await browser.wait('values', lambda found: found.get('number') == 1999)
        assert len(studio.seats[browser.room].waiting) < 30
        return found['values']['condition.friction']

    assert served(task) == '0.49975'
