"""The server of the page: an event loop in a thread of its own, which nodes hand immutable sections to."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import socket
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from threading import Thread
from typing import Final, Protocol, TypeVar

from aiohttp import web
from pydantic import ValidationError

from tbm_gsa.app.web.guarding import HEADERS, OWN_CONTENT, REPORT_CONTENT, TOKEN_HEADER, refusal
from tbm_gsa.app.web.state import Acknowledgement, PageList, Waterfall
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.reading import Part
from tbm_msgs_py.base.errors import InputError

PATIENCE_S: Final = 10.0
"""Longest time in which a client takes nothing of what is sent."""
HEARTBEAT_S: Final = 20.0
"""Between pings; a client that does not answer within half of it is gone."""
MOST_CLIENTS: Final = 100
_END_S: Final = 0.5
"""Longest wait for clients at the end."""
_BUFFER: Final = 64 << 10  # bytes that wait for one client beyond the message that is sent
_LARGEST_REQUEST: Final = 16 << 10  # bytes
_KINDS: Final = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


Answer = TypeVar("Answer")


class Site(Protocol):
    """What the page asks for; called in threads of the server."""

    def waterfall(self, point: str) -> Waterfall:
        """Rows of the last minutes."""

    def drawing(self) -> bytes:
        """Drawing of the machine, SVG."""

    def pages(self) -> PageList:
        """Pages of studies, explanations and comparisons."""

    def page(self, key: str) -> str | None:
        """Content of one of them."""

    def acknowledge(self, asked: Acknowledgement) -> ListedEvent:
        """Acknowledge an event; an InputError is told to who asked."""


class _Section:
    """A section of the page: what it is now, as text once somebody wants it."""

    def __init__(self, name: str, content: Part) -> None:
        self._name, self._content, self._text = name, content, ""

    def text(self) -> str:
        if not self._text:
            self._text = f'{{"section": "{self._name}", "content": {self._content.model_dump_json()}}}'
        return self._text


class WebServer:
    """Serves the page at an address until it is closed.

    Every client has the newest state of each section and a bounded buffer: one that reads slowly gets fewer states, one
    that reads nothing is closed. Nothing here waits for a client, and no caller for the server.

    Parameters
    ----------
    host, port : str, int
        Port 0: a free one.
    site : Site
    names : iterable of str
        By which clients may call this computer, beside its addresses and ``localhost``.

    Attributes
    ----------
    port : int
    token : str
        Word that requests which write have to state.
    version : str
        Of the page's own files.
    sent_bytes : int
        To all clients.
    problem : str
        The last error that nothing expected; empty before there is one.

    Raises
    ------
    InputError
        The address cannot be used.
    """

    def __init__(self, host: str, port: int, site: Site, names: frozenset[str] = frozenset()) -> None:
        self.token, self.sent_bytes, self.problem = secrets.token_urlsafe(16), 0, ""
        self._site, self._names = site, names | {"localhost"}
        self._static = {file.name: file.read_bytes() for file in files("tbm_gsa.app.web").joinpath("static").iterdir()}
        self.version = hashlib.sha256(b"".join(self._static[name] for name in sorted(self._static))).hexdigest()[:16]
        self._sections: dict[str, _Section] = {}
        self._clients: set[web.WebSocketResponse] = set()
        self._pool = ThreadPoolExecutor(2, "web site")
        self._loop = asyncio.new_event_loop()
        self._changed = asyncio.Event()
        started: Future[int] = Future()
        self._thread = Thread(target=self._run, args=(host, port, started), name="web", daemon=True)
        self._thread.start()
        try:
            self.port = started.result()
        except OSError as error:
            self._thread.join()
            raise InputError(f"{host}:{port}: {error.strerror or error}") from None

    @property
    def clients(self) -> int:
        """Clients that are connected."""
        return len(self._clients)

    def show(self, name: str, content: Part) -> None:
        """Show a section; a client that is late gets the newest one only."""
        self._loop.call_soon_threadsafe(self._put, name, content)

    def close(self) -> None:
        """End all connections, and the thread."""
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()

    def _run(self, host: str, port: int, started: Future[int]) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(host, port, started))
        except Exception as error:  # noqa: BLE001 - whoever waits for the start is told of any
            if started.done():
                self.problem = f"server: {type(error).__name__}: {error}"
            else:
                started.set_exception(error)
        finally:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._loop.close()

    async def _serve(self, host: str, port: int, started: Future[int]) -> None:
        self._ending = asyncio.Event()
        runner = web.AppRunner(self._application(), access_log=None, shutdown_timeout=_END_S)
        await runner.setup()
        try:
            await web.TCPSite(runner, host, port).start()
            started.set_result(runner.addresses[0][1])
            await self._ending.wait()
            ends = [asyncio.create_task(client.close(code=1001)) for client in tuple(self._clients)]
            if ends:
                await asyncio.wait(ends, timeout=_END_S)  # of those that read nothing the connection just ends
        finally:
            await runner.cleanup()

    def _application(self) -> web.Application:
        application = web.Application(middlewares=[self._guard], client_max_size=_LARGEST_REQUEST)
        application.on_response_prepare.append(_add_headers)
        application.add_routes(
            [
                web.get("/", self._index),
                web.get("/static/{name}", self._file),
                web.get("/live", self._live),
                web.get("/drawing.svg", self._drawing),
                web.get("/waterfall/{point}", self._waterfall),
                web.get("/pages", self._pages),
                web.get("/pages/{key}", self._page),
                web.post("/events", self._acknowledge),
            ]
        )
        return application

    def _put(self, name: str, content: Part) -> None:
        self._sections[name] = _Section(name, content)
        self._changed.set()
        self._changed = asyncio.Event()

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        if reason := refusal(request.host, request.headers.get("Origin"), self._names):
            return web.Response(status=403, text=reason)
        try:
            return await handler(request)
        except (web.HTTPException, ConnectionError):
            raise
        except Exception as error:  # noqa: BLE001 - aiohttp would print a traceback for each
            self.problem = f"{request.method} {request.path}: {type(error).__name__}: {error}"
            return web.Response(status=500, text="a fault of the program; its log says more")

    async def _ask(self, question: Callable[..., Answer], *arguments: object) -> Answer:
        """Ask the site, in a thread that may wait."""
        return await self._loop.run_in_executor(self._pool, partial(question, *arguments))

    async def _index(self, _request: web.Request) -> web.Response:
        return self._content("index.html")

    async def _file(self, request: web.Request) -> web.Response:
        return self._content(request.match_info["name"])

    def _content(self, name: str) -> web.Response:
        if name not in self._static:
            raise web.HTTPNotFound
        kind = _KINDS[f".{name.rpartition('.')[2]}"]
        return web.Response(body=self._static[name], content_type=kind, charset="utf-8")

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if len(self._clients) >= MOST_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"{MOST_CLIENTS} clients are connected, which is the most")
        client = web.WebSocketResponse(heartbeat=HEARTBEAT_S, compress=False, max_msg_size=1024, timeout=_END_S)
        await client.prepare(request)
        _bound_buffers(request)
        self._clients.add(client)
        sending = asyncio.create_task(self._send(client, request))
        try:
            async for _ in client:  # nothing is expected; pings and the end are seen here
                pass
        finally:
            self._clients.discard(client)
            sending.cancel()
        return client

    async def _send(self, client: web.WebSocketResponse, request: web.Request) -> None:
        sent: dict[str, _Section] = {}
        while True:
            changed = self._changed
            for name in tuple(self._sections):
                section = self._sections[name]
                if sent.get(name) is section:
                    continue
                text = section.text()
                try:
                    await asyncio.wait_for(client.send_str(text), PATIENCE_S)
                except (TimeoutError, ConnectionError):
                    if request.transport is not None:
                        request.transport.abort()
                    return
                sent[name] = section
                self.sent_bytes += len(text)
            await changed.wait()

    async def _drawing(self, _request: web.Request) -> web.Response:
        return web.Response(body=await self._ask(self._site.drawing), content_type=_KINDS[".svg"])

    async def _waterfall(self, request: web.Request) -> web.Response:
        return _json(await self._ask(self._site.waterfall, request.match_info["point"]))

    async def _pages(self, _request: web.Request) -> web.Response:
        return _json(await self._ask(self._site.pages))

    async def _page(self, request: web.Request) -> web.Response:
        content = await self._ask(self._site.page, request.match_info["key"])
        if content is None:
            raise web.HTTPNotFound
        headers = {"Content-Security-Policy": REPORT_CONTENT}
        return web.Response(text=content, content_type="text/html", headers=headers)

    async def _acknowledge(self, request: web.Request) -> web.Response:
        stated = request.headers.get(TOKEN_HEADER, "")
        if not secrets.compare_digest(stated.encode(errors="surrogateescape"), self.token.encode()):
            return web.Response(status=403, text=f"no {TOKEN_HEADER} of this page; load it again")
        try:
            asked = Acknowledgement.model_validate_json(await request.read())
            return _json(await self._ask(self._site.acknowledge, asked))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"]))
            return web.Response(status=400, text=f"{place}: {first['msg']}" if place else first["msg"])
        except InputError as error:
            return web.Response(status=400, text=str(error))


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    for name, value in (HEADERS | {"Content-Security-Policy": OWN_CONTENT}).items():
        response.headers.setdefault(name, value)


def _json(content: Part) -> web.Response:
    return web.Response(text=content.model_dump_json(), content_type="application/json")


def _bound_buffers(request: web.Request) -> None:
    """Let little wait for a client, in this process and in the system: what waits there is old when it comes."""
    if request.transport is None:
        return
    request.transport.set_write_buffer_limits(high=_BUFFER)
    connection = request.transport.get_extra_info("socket")
    if connection is not None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
