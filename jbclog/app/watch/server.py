"""The live view as a page: one process that follows a run and serves it to any number of browsers,
with Starlette and uvicorn.

1. It only reads, and answers GET and HEAD only.
2. A request must name a host that this server was started for (against DNS rebinding), and come
   from no other origin.
3. Beyond the loopback addresses a token is required, from the address line once, then from a
   cookie.
4. Nothing is loaded from elsewhere: the policy allows this server's own files, no inline script or
   style, no frame.
5. A browser that reads nothing for a while is disconnected; it connects again and gets the whole
   state. So is a connection without a whole request.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from io import BufferedReader
from pathlib import Path
from typing import Final

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jbclog.app.watch import words
from jbclog.app.watch.batch_queue import BatchQueue
from jbclog.app.watch.connections import AT_ONCE, Connection
from jbclog.app.watch.feed import Feed
from jbclog.app.watch.past_runs import RunList, open_report
from jbclog.core.errors import JbclogError, UsageError, unexpected_error_text
from jbclog.core.text import clean, json_line
from jbclog.live import RunState

EVERY_S: Final = 0.5
MOST_BROWSERS: Final = 100
GRACE_S: Final = 2  # for pending answers when the server ends
WAITING: Final = 20  # messages for a slow browser
# bytes of a report, or of the whole state, at once: a client may read nothing
PIECE: Final = 64 << 10
COOKIE: Final = "jbclog_token"
LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
OF_REPORT: Final = (
    "sandbox allow-scripts allow-popups allow-modals; default-src 'none'; script-src"
    " 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; font-src data:; frame-ancestors"
    " 'none'"
)
"""Policy of a report: the file may be foreign, so it has no origin here, and its own policy holds
as well.
"""
HEADERS: Final = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)
ALONE: Final = (b"cross-origin-opener-policy", b"same-origin")
"""Over plain HTTP, a browser that used a host name ignores this header, with an error on its
console. It sends `Sec-Fetch-Site` only where it would obey it, over HTTPS and on loopback; a proxy
passes that on.
"""
HOME: Final = Path(__file__).parent / "static"
UPLOT: Final = Path(__file__).parents[2] / "report" / "vendor" / "uplot"
FILES: Final = {
    "/": (HOME / "watch.html", "text/html"),
    "/watch.css": (HOME / "watch.css", "text/css"),
    "/trace.js": (HOME / "trace.js", "text/javascript"),
    "/watch.js": (HOME / "watch.js", "text/javascript"),
    "/uplot.css": (UPLOT / "uPlot.min.css", "text/css"),
    "/uplot.js": (UPLOT / "uPlot.iife.min.js", "text/javascript"),
}

CSP: Final = b"content-security-policy"

Source = Callable[[], RunState | None]
Queues = Callable[[], Sequence[BatchQueue]]
Queue = asyncio.Queue[str | None]


@dataclass(frozen=True, slots=True)
class Access:
    """Who may read: the address that the server listens on, and a `token` if one is required."""

    address: str
    token: str | None

    def knows_host(self, host: str) -> bool:
        """Whether the header Host of a request names this server. Its port may be that of a tunnel
        or a container.
        """
        name = host.rpartition(":")[0] if not host.endswith("]") and ":" in host else host
        name = name.strip("[]").lower()
        return (
            name in LOOPBACK
            or name == self.address.lower()
            or (self.token is not None and _is_own(name, self.address))
        )

    def is_allowed(self, given: str | None) -> bool:
        """Whether a token, from the address line or a cookie, is right."""
        return self.token is None or (
            given is not None and hmac.compare_digest(given.encode(), self.token.encode())
        )


def _is_own(name: str, address: str) -> bool:
    """Whether a name can be this machine's, if the server listens on all addresses."""
    if not is_any(address):
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in own_names()
    return True


@cache
def own_names() -> frozenset[str]:
    """Return the names of this machine. Cached: a resolver may take seconds, and any request could
    cause a lookup.
    """
    return frozenset((socket.gethostname().lower(), socket.getfqdn().lower()))


def is_any(address: str) -> bool:
    """Whether an address stands for all addresses of this machine."""
    try:
        return ipaddress.ip_address(address).is_unspecified
    except ValueError:
        return False


def is_loopback(address: str) -> bool:
    """Whether an address can be reached from this machine only."""
    try:
        return address == "localhost" or ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


class Guard:
    """Refuses requests that are not for this server, and adds the headers to all answers."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        request = Request(scope)
        extra = [*HEADERS, *([ALONE] if "sec-fetch-site" in request.headers else [])]

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = list(message.get("headers", ()))
                has_policy = any(name == CSP for name, _ in headers)
                message["headers"] = (
                    headers + extra + ([] if has_policy else [(CSP, POLICY.encode())])
                )
            await send(message)

        answer = self._refusal(request) or self._app
        await answer(scope, receive, guarded)

    def _refusal(self, request: Request) -> Response | None:
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if not self._access.knows_host(host):
            return PlainTextResponse("this server has another name", 421)
        if origin is not None and origin != f"{request.url.scheme}://{host}":
            return PlainTextResponse("requests from other pages are refused", 403)
        if request.method not in ("GET", "HEAD"):
            return PlainTextResponse("this server only reads", 405, {"allow": "GET, HEAD"})
        given = request.query_params.get("token")
        if given is not None and self._access.token is not None and self._access.is_allowed(given):
            # removes the token from the address line
            answer = RedirectResponse(request.url.path, 303)
            answer.set_cookie(
                COOKIE,
                given,
                httponly=True,
                samesite="strict",
                secure=request.url.scheme == "https",
            )
            return answer
        if not self._access.is_allowed(request.cookies.get(COOKIE)):
            return PlainTextResponse(
                "a token is required: open the address that `jbclog watch --web` has shown", 401
            )
        return None


@dataclass(slots=True)
class Broadcast:
    """Reads `source` twice a second and sends each message to all browsers."""

    source: Source
    queues: Queues = tuple
    feed: Feed = field(default_factory=Feed)
    browsers: set[Queue] = field(default_factory=set)
    whole: str | None = None  # the whole state, once for all who join between two messages

    async def run(self) -> None:
        while True:
            self._hand_out(await asyncio.to_thread(self._read))
            await asyncio.sleep(EVERY_S)

    def _read(self) -> str:
        try:
            return self.feed.change(self.source(), self.queues())
        except JbclogError as error:
            return json_line({"trouble": clean(str(error))})
        except Exception as error:  # shown, and tried again
            return json_line({"trouble": f"internal error, {unexpected_error_text(error)}"})

    def _hand_out(self, message: str) -> None:
        self.whole = None
        for queue in list(self.browsers):
            if queue.qsize() >= WAITING:
                self.browsers.discard(queue)  # it has read nothing for ten seconds
                while not queue.empty():
                    queue.get_nowait()
                queue.put_nowait(None)
            else:
                queue.put_nowait(message)

    def end(self) -> None:
        """End all streams."""
        for queue in self.browsers:
            queue.put_nowait(None)

    def join(self) -> Queue | None:
        """Add a browser at once, so that simultaneous requests count; None: there are enough."""
        if len(self.browsers) >= MOST_BROWSERS:
            return None
        queue = Queue()
        self.browsers.add(queue)
        return queue

    async def messages(self, queue: Queue) -> AsyncIterator[str]:
        """Yield the messages for a browser: the whole state, then changes, until it is too slow."""
        # the first change may repeat points; the page ignores those that it has
        if self.whole is None:
            self.whole = self.feed.whole()
        whole = _event(self.whole) if self.whole else ""
        for place in range(0, len(whole), PIECE):
            yield whole[place : place + PIECE]
        while (message := await queue.get()) is not None:
            yield _event(message)


class Stream(StreamingResponse):
    """The messages to one browser, removed from the broadcast when its answer ends, even one that
    never began.
    """

    def __init__(self, broadcast: Broadcast, queue: Queue) -> None:
        super().__init__(broadcast.messages(queue), media_type="text/event-stream")
        self._broadcast, self._queue = broadcast, queue

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._broadcast.browsers.discard(self._queue)


class FileStream(StreamingResponse):
    """An open file in pieces, closed at the end of the answer."""

    def __init__(self, file: BufferedReader, media_type: str, headers: dict[str, str]) -> None:
        super().__init__(iter(partial(file.read, PIECE), b""), 200, headers, media_type)
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._file.close()


def _event(message: str) -> str:
    return f"data: {message}\n\n"


def application(broadcast: Broadcast, access: Access, path: Path) -> ASGIApp:
    """Return the page of the run or folder at `path` as an ASGI application."""

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(broadcast.run())
        yield
        task.cancel()

    async def events(_: Request) -> Response:
        queue = broadcast.join()
        if queue is None:
            return PlainTextResponse(f"{MOST_BROWSERS} browsers are connected already", 503)
        return Stream(broadcast, queue)

    listed = RunList(path)

    async def runs(_: Request) -> Response:
        try:
            return Response(await listed.text(), media_type="application/json")
        except OSError as error:
            return PlainTextResponse(f"the runs cannot be listed: {error.strerror or error}", 500)

    def report(request: Request) -> Response:
        try:
            file = open_report(path, request.path_params["name"])
        except OSError:
            return PlainTextResponse("this run has no report; `jbclog report` writes it", 404)
        return FileStream(file, "text/html; charset=utf-8", {CSP.decode(): OF_REPORT})

    routes = [Route(place, _file(file, kind)) for place, (file, kind) in FILES.items()]
    routes += [Route("/favicon.ico", lambda _: Response(status_code=204)), Route("/events", events)]

    async def hour(request: Request) -> Response:
        found = broadcast.feed.hour(request.query_params.get("port", ""))
        return (
            PlainTextResponse("no such port", 404)
            if found is None
            else Response(found, media_type="application/json")
        )

    routes += [Route("/hour", hour)]
    routes += [Route("/runs", runs), Route("/runs/{name}", report)]
    return Guard(Starlette(routes=routes, lifespan=lifespan), access)


def _file(path: Path, kind: str) -> Callable[[Request], Response]:
    data = path.read_bytes()
    return lambda _: Response(data, media_type=f"{kind}; charset=utf-8")


def listening(address: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises `UsageError` if the port is in use or the address is not this machine's.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_STREAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((address, port))
        opened.listen(AT_ONCE)
    except OSError as error:
        opened.close()
        raise UsageError(
            f"{address} port {port} cannot be used: {error.strerror or error}; choose another with"
            " --port"
        ) from error
    return opened


class PageServer(uvicorn.Server):
    """Serves the page of a run; `run` takes a list with a socket of `listening`, and ends at SIGINT
    or SIGTERM.
    """

    def __init__(self, source: Source, access: Access, path: Path, queues: Queues = tuple) -> None:
        if is_any(access.address):
            own_names()  # cached before any client waits for it
        self._broadcast = Broadcast(source, queues, Feed(words.no_run(path)))
        app = application(self._broadcast, access, path)
        config = uvicorn.Config(
            app,
            http=Connection,
            backlog=AT_ONCE,
            ws="none",
            log_level="error",
            access_log=False,
            server_header=False,
        )
        config.timeout_graceful_shutdown = GRACE_S
        super().__init__(config)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams first; they would never end by themselves."""
        self._broadcast.end()
        await super().shutdown(sockets)
