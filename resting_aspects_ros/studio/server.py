"""The server of the page: who may ask, what there is, and the messages of each tab.

It listens on this computer only. Everything else that opens a page in the same browser must not
reach it: see `guard`. Its modules import quickly; those that compute are imported in a thread
while the first page is shown.
"""

import asyncio
import contextlib
import hmac
import json
import re
import secrets
import shutil
import tempfile
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aiohttp import WSCloseCode, WSMsgType, web

from resting_aspects_ros.errors import RestingAspectsError, one_line, shown
from resting_aspects_ros.studio.page import TITLES, examples, templates
from resting_aspects_ros.system import available_cores

if TYPE_CHECKING:  # these imports are slow
    from resting_aspects_ros.simulation.workers import LocalWorkers
    from resting_aspects_ros.studio.opening import Opener
    from resting_aspects_ros.studio.room import Room

HOST = '127.0.0.1'
NAMES = ('127.0.0.1', 'localhost', '[::1]')
TOKEN_BYTES = 16
MAX_UPLOAD = 256 << 20  # bytes, the maximum of a mesh file
MAX_MESSAGE = 64 << 10  # bytes
PERIOD = 0.05  # s, between messages to a tab
ROOM_LIFE = 600.0  # s, after its last tab
RELOAD = 1.0  # s, in which the tab that was there before a reload closes its socket
ENDINGS = ('step', 'stp', 'stl', 'obj', 'ply', '3mf')
UNITS = ('mm', 'cm', 'm', 'in', 'ft', 'um')
STATIC = {
    'page.css': ('report', 'text/css'),
    'view.js': ('report', 'text/javascript'),
    'three.module.min.js': ('report', 'text/javascript'),
    'OrbitControls.js': ('report', 'text/javascript'),
    'studio.css': ('studio', 'text/css'),
    'studio.js': ('studio', 'text/javascript'),
}
POLICY = (
    "default-src 'none'; script-src 'self' 'nonce-{nonce}'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
# Of everything that is not the page.
CLOSED_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


# -- Who may ask ----------------------------------------------------------------------------------


@web.middleware
async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Refuse requests that do not come from the page itself or from the user's own navigation.

    A foreign site can make the browser send requests to this computer. It cannot choose their
    headers: Host names another host after DNS rebinding, Origin and Sec-Fetch-Site name the site.
    """
    studio = request.app[STUDIO]
    host = request.headers.get('Host', '')
    if host not in {f'{name}:{studio.port}' for name in NAMES}:
        raise web.HTTPForbidden(text='invalid Host')
    origin = request.headers.get('Origin')
    is_socket = request.headers.get('Upgrade', '').lower() == 'websocket'
    if origin != f'http://{host}' and (origin is not None or is_socket):
        raise web.HTTPForbidden(text='invalid Origin')
    site = request.headers.get('Sec-Fetch-Site', 'none')
    navigates = request.headers.get('Sec-Fetch-Mode') == 'navigate' and request.method == 'GET'
    if site not in ('same-origin', 'none') and not navigates:
        raise web.HTTPForbidden(text='invalid Sec-Fetch-Site')
    token = request.match_info.get('token', '')
    if not hmac.compare_digest(token.encode(), studio.token.encode()):
        raise web.HTTPNotFound(text='not found')
    return await handler(request)


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    response.headers.setdefault('Content-Security-Policy', CLOSED_POLICY)
    response.headers['X-Content-Type-Options'] = 'nosniff'
    response.headers['Referrer-Policy'] = 'no-referrer'
    response.headers['X-Frame-Options'] = 'DENY'
    response.headers['Cross-Origin-Opener-Policy'] = 'same-origin'
    response.headers['Cross-Origin-Resource-Policy'] = 'same-origin'
    response.headers['Cache-Control'] = 'no-store'


# -- Tabs -----------------------------------------------------------------------------------------


@dataclass(eq=False)
class Seat:
    """A room with its socket, if a tab of the browser shows it.

    latest : dict of str to str
        The latest message of each topic, from which a tab is restored.
    waiting : dict of str to str
        Messages that were not sent yet: a slow browser receives the latest of each topic.
    """

    key: str
    room: 'Room' = field(init=False)  # made after the seat, to which it publishes
    socket: web.WebSocketResponse | None = None
    left: float = 0.0
    latest: dict[str, str] = field(default_factory=dict)
    waiting: dict[str, str] = field(default_factory=dict)
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, topic: str, text: str) -> None:
        """Take a message, unless the tab shows it already."""
        if self.latest.get(topic) == text and topic not in self.waiting:
            return
        self.latest[topic] = text
        # In the order in which the topics were last published.
        self.waiting.pop(topic, None)
        self.waiting[topic] = text
        self.news.set()


class Studio:
    """The state of the server.

    Parameters
    ----------
    first : str
        The part that a new room opens: an example or a file; empty for none.
    clock : callable
        Returns seconds.
    """

    def __init__(self, first: str = '', clock: Callable[[], float] = time.monotonic) -> None:
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self.port = 0
        self.first, self.clock = first, clock
        self.folder = Path(tempfile.mkdtemp(prefix='resting_aspects_studio_'))
        self.seats: dict[str, Seat] = {}
        self._lock = threading.Lock()
        self._tools: tuple[LocalWorkers, Opener] | None = None

    # -- Rooms --------------------------------------------------------------------------------

    def tools(self) -> 'tuple[LocalWorkers, Opener]':
        """Return the workers of all rooms and what opens parts, made on the first call."""
        with self._lock:
            if self._tools is None:
                from resting_aspects_ros.simulation.workers import LocalWorkers
                from resting_aspects_ros.studio.opening import Opener
                from resting_aspects_ros.studio.room import route_warnings

                opener = Opener()
                opener.prepare()
                route_warnings()
                self._tools = LocalWorkers(available_cores()), opener
            return self._tools

    async def seat(self, key: Any) -> Seat:
        """Return the room of a key if no tab shows it, else a new one.

        A window that is opened from a tab has a copy of its key, but not its room.
        """
        known = self.seats.get(key) if isinstance(key, str) else None
        if known is not None:
            end = self.clock() + RELOAD
            while known.socket is not None and self.clock() < end:
                await asyncio.sleep(PERIOD)
            if known.socket is None:
                return known
        await self.end_left_rooms()
        return await self._new_seat()

    async def _new_seat(self) -> Seat:
        loop = asyncio.get_running_loop()
        seat = Seat(secrets.token_urlsafe(TOKEN_BYTES))
        folder = self.folder / seat.key
        folder.mkdir()

        def publish(topic: str, message: dict[str, Any]) -> None:
            text = json.dumps({'topic': topic, **message})
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(seat.put, topic, text)

        def make() -> 'Room':
            from resting_aspects_ros.studio.room import Room

            workers, opener = self.tools()
            return Room(workers, opener, publish, folder, self.clock)

        seat.room = await loop.run_in_executor(None, make)
        self.seats[seat.key] = seat
        if self.first:
            from resting_aspects_ros.studio.rows import source_of

            seat.room.open(source_of(self.first))
        return seat

    async def end_left_rooms(self) -> None:
        """End the rooms whose last tab was closed long ago."""
        now = self.clock()
        for key, seat in list(self.seats.items()):
            if seat.socket is None and now - seat.left > ROOM_LIFE:
                del self.seats[key]
                await asyncio.get_running_loop().run_in_executor(None, seat.room.close)

    async def close_sockets(self) -> None:
        """Tell the tabs that the server ends."""
        for seat in self.seats.values():
            if seat.socket is not None:
                await seat.socket.close(code=WSCloseCode.GOING_AWAY)

    async def end(self) -> None:
        """End all rooms, workers and processes, and remove the files."""
        loop = asyncio.get_running_loop()
        for seat in self.seats.values():
            await loop.run_in_executor(None, seat.room.close)
        self.seats.clear()
        with self._lock:
            tools, self._tools = self._tools, None
        if tools is not None:
            await loop.run_in_executor(None, tools[1].end)
            await loop.run_in_executor(None, tools[0].stop)
        shutil.rmtree(self.folder, ignore_errors=True)


STUDIO = web.AppKey('studio', Studio)


# -- Routes ---------------------------------------------------------------------------------------


def make_app(studio: Studio) -> web.Application:
    """Return the application; everything is below the token."""
    app = web.Application(middlewares=[guard], client_max_size=MAX_MESSAGE)
    app[STUDIO] = studio
    app.on_response_prepare.append(_add_headers)
    app.router.add_get('/{token}/', _page)
    app.router.add_get('/{token}/static/{name}', _static)
    app.router.add_get('/{token}/socket', _socket)
    app.router.add_put('/{token}/part/{room}/{side}', _upload)
    app.router.add_get('/{token}/file/{room}/{name}', _file)
    app.on_shutdown.append(lambda _: studio.close_sockets())
    app.on_cleanup.append(lambda _: studio.end())
    return app


async def _page(_request: web.Request) -> web.Response:
    nonce = secrets.token_urlsafe(TOKEN_BYTES)
    html = (
        templates()
        .get_template('studio.html')
        .render(
            nonce=nonce,
            tabs=TITLES,
            examples=examples(),
            units=UNITS,
            endings=','.join(f'.{each}' for each in ENDINGS),
        )
    )
    policy = POLICY.format(nonce=nonce)
    return web.Response(
        text=html, content_type='text/html', headers={'Content-Security-Policy': policy}
    )


async def _static(request: web.Request) -> web.Response:
    name = request.match_info['name']
    if name not in STATIC:
        raise web.HTTPNotFound(text='not found')
    room, media_type = STATIC[name]
    folder = resources.files(f'resting_aspects_ros.{room}') / 'page_files'
    data = (folder / name).read_bytes()
    return web.Response(body=data, content_type=media_type, charset='utf-8')


def _seat_of(request: web.Request) -> Seat:
    seat = request.app[STUDIO].seats.get(request.match_info['room'])
    if seat is None:
        raise web.HTTPNotFound(text='This tab has ended: reload the page.')
    return seat


async def _upload(request: web.Request) -> web.Response:
    """Store a file below a name of our own, and open it."""
    seat, side = _seat_of(request), request.match_info['side']
    name = _shown_name(request.query.get('name', ''))
    ending = name.rpartition('.')[2].lower()
    if ending not in ENDINGS or side not in ('first', 'second'):
        expected = ', '.join(f'.{each}' for each in ENDINGS)
        raise web.HTTPUnsupportedMediaType(
            text=f'invalid file {shown(name)}: expected one that ends in {expected}'
        )
    if (request.content_length or 0) > MAX_UPLOAD:
        raise web.HTTPRequestEntityTooLarge(MAX_UPLOAD, request.content_length or 0)
    folder = Path(tempfile.mkdtemp(dir=seat.room.folder))
    path = folder / f'part.{ending}'
    size = 0
    with contextlib.ExitStack() as cleanup:  # after a full disk, or if the tab is closed
        cleanup.callback(shutil.rmtree, folder, ignore_errors=True)
        try:
            with path.open('wb') as file:
                async for chunk in request.content.iter_chunked(1 << 20):
                    size += len(chunk)
                    if size > MAX_UPLOAD:
                        raise web.HTTPRequestEntityTooLarge(MAX_UPLOAD, size)
                    file.write(chunk)
        except OSError as error:
            reason = error.strerror or error
            raise web.HTTPInsufficientStorage(text=f'{name} was not stored: {reason}') from None
        cleanup.pop_all()
    from resting_aspects_ros.studio.rows import Source

    seat.room.open(Source(name, path), side)
    return web.Response(text='')


def _shown_name(name: str) -> str:
    """Return the last component of a name that a browser sent, without control characters."""
    name = re.split(r'[/\\]', name)[-1]
    return one_line(name, 200) or 'part'


async def _file(request: web.Request) -> web.Response:
    """Make and send a file of a room."""
    from resting_aspects_ros.studio.export import FILES

    seat, name = _seat_of(request), request.match_info['name']
    if name not in FILES:
        raise web.HTTPNotFound(text='not found')
    made = FILES[name]
    loop = asyncio.get_running_loop()
    try:
        data = await loop.run_in_executor(None, lambda: made.make(seat.room.work()))
    except RestingAspectsError as error:
        raise web.HTTPConflict(text=str(error)) from None
    return web.Response(
        body=data,
        content_type=made.media_type,
        headers={'Content-Disposition': f'attachment; filename="{name}"'},
    )


# -- The socket -----------------------------------------------------------------------------------


async def _socket(request: web.Request) -> web.WebSocketResponse:
    studio = request.app[STUDIO]
    socket = web.WebSocketResponse(max_msg_size=MAX_MESSAGE, heartbeat=30.0)
    await socket.prepare(request)
    first = await socket.receive()
    try:
        hello = json.loads(first.data) if first.type is WSMsgType.TEXT else None
        seat = await studio.seat(hello.get('room') if isinstance(hello, dict) else None)
    except (ValueError, RestingAspectsError) as error:
        await socket.send_json({'topic': 'problem', 'text': str(error)})
        await socket.close()
        return socket
    seat.socket = socket
    sender: asyncio.Task[None] | None = None
    try:
        # Raises ConnectionError if the tab was closed while its room was made.
        await socket.send_json({'topic': 'room', 'room': seat.key})
        seat.waiting = dict(seat.latest)
        seat.news.set()
        sender = asyncio.create_task(_send(seat, socket))
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                problem: str | None = 'invalid message: expected text'
            else:
                problem = _receive(seat, message.data)
            if problem is not None:
                seat.put('problem', json.dumps({'topic': 'problem', 'text': problem}))
    except ConnectionError:
        pass
    finally:
        if sender is not None:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender
        seat.socket, seat.left = None, studio.clock()
    return socket


async def _send(seat: Seat, socket: web.WebSocketResponse) -> None:
    """Send what is new, the latest message of each topic, not too often."""
    while True:
        await seat.news.wait()
        seat.news.clear()
        messages, seat.waiting = list(seat.waiting.values()), {}
        for text in messages:
            await socket.send_str(text)
        await asyncio.sleep(PERIOD)


def _receive(seat: Seat, text: str) -> str | None:
    """Do what a message requests; returns a sentence if it is wrong, '' after a good change."""
    room = seat.room
    try:
        message = json.loads(text)
        if not isinstance(message, dict):
            return f'invalid message {shown(text)}: expected an object'
        number = message.get('number')
        if 'set' in message:
            name = message['set']
            if not isinstance(name, str):
                return f'invalid setting {shown(name)}: expected text'
            room.change(name, message.get('to'), number if type(number) is int else None)
        elif 'example' in message:
            room.open_example(message['example'], _side(message))
        elif 'again' in message:
            room.open_again(message['again'], message.get('to'), _side(message))
        else:
            tasks: dict[Any, Callable[[], None]] = {
                'now': room.work_now,
                'cancel': room.cancel,
                'same': room.forget_second,
            }
            task = message.get('do')
            if not isinstance(task, str) or task not in tasks:
                return f'invalid message {shown(text)}: expected a change of the page'
            tasks[task]()
    except RestingAspectsError as error:
        return str(error)
    except (ValueError, RecursionError):
        return f'invalid message {shown(text)}: expected JSON'
    return None


def _side(message: dict[str, Any]) -> str:
    return 'second' if message.get('side') == 'second' else 'first'


# -- The command ----------------------------------------------------------------------------------


async def serve(
    studio: Studio, port: int, ready: Callable[[str], None], stopped: Callable[[], bool]
) -> None:
    """Serve the page until ``stopped`` returns True; raises OSError if the port is taken.

    ``ready`` is called with the address of the page.
    """
    runner = web.AppRunner(make_app(studio), access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        site = web.TCPSite(runner, HOST, port)
        await site.start()
        studio.port = runner.addresses[0][1]
        ready(f'http://{HOST}:{studio.port}/{studio.token}/')
        prepared = asyncio.get_running_loop().run_in_executor(None, studio.tools)
        checked = studio.clock()
        while not stopped():
            await asyncio.sleep(PERIOD)
            if studio.clock() - checked > ROOM_LIFE / 10:
                checked = studio.clock()
                await studio.end_left_rooms()
        await prepared
    finally:
        await runner.cleanup()
