"""The web application: static files, one stream of state for each viewer, and the few requests that act.

Static files need no token, everything else does: in the first message of the stream, else as a bearer token. A
request of a page from elsewhere is refused by its Origin, a name that leads here by DNS rebinding by its Host.

The record button of the page keeps the last minutes as one recording, as ``trepid record keep`` does.
"""

import asyncio
import contextlib
import json
import secrets
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from cockpit.page.hub import MAX_VIEWERS, Hub, Viewer
from cockpit.page.rules import Conflict, RuleDesk
from cockpit.page.stop import StopSender
from trepid.config import InputError
from trepid.processes.page_door import PageDoor
from trepid.recording.ring import keep_in_other_process, kept_name, state_folder


class KeepDesk:
    """Keeps the last minutes of this drive, where it writes them."""

    def __init__(self, *, ring: str | None, recorded: str | None) -> None:
        """``ring``: name of the ring of this drive, None without one. ``recorded``: the file of the whole drive."""
        self._ring = ring
        self.why_not = ""
        """Why there is nothing to keep; "" where the last minutes are written."""
        if recorded is not None:
            self.why_not = f"the whole drive is recorded in {recorded}"
        elif ring is None:
            self.why_not = "the last minutes are not written: ring.max_mb of drive.yaml is 0"

    def keep(self) -> Path:
        """Keep the last minutes in a new file; another process of low priority joins the parts.

        Raises InputError.
        """
        if self.why_not or self._ring is None:
            raise InputError(self.why_not)
        path = kept_name("page", now_s=time.time())
        keep_in_other_process(state_folder("ring") / self._ring, path)
        return path


STATIC = Path(__file__).parent / "static"
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}
GREETING_S = 5.0  # in which a viewer gives its token
LONGEST_REASON = 123  # bytes of UTF-8
WRONG_TOKEN, WRONG_ORIGIN, DRIVE_ENDED, TOO_MANY = 4401, 4403, 4410, 4429
"""Codes that end a stream."""
MAX_BODY = 2**19
Acts = Callable[[Request], Awaitable[Response]]


class Refusal(Exception):
    """A request that is not served: status and reason."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class Headers:
    """Adds HEADERS to every response."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    *((name.encode(), value.encode()) for name, value in HEADERS.items()),
                ]
            await send(message)

        await self._app(scope, receive, with_headers)


class PageServer:
    """The requests of a page."""

    def __init__(self, door: PageDoor, hub: Hub, stop: StopSender, desk: RuleDesk, keeping: KeepDesk) -> None:
        self._door, self._hub, self._stop, self._desk = door, hub, stop, desk
        self._keeping, self._one_at_a_time = keeping, asyncio.Lock()
        self._streams: set[WebSocket] = set()
        self._hosts = {f"{name}:{door.port}" for name in ("127.0.0.1", "localhost", "[::1]", door.host)}

    def application(self) -> Starlette:
        """The routes."""
        return Starlette(
            routes=[
                Route("/", self._index),
                Mount("/static", StaticFiles(directory=STATIC)),
                WebSocketRoute("/stream", self._stream),
                Route("/stop", self._guard(self._press), methods=["POST"]),
                Route("/keep", self._guard(self._keep), methods=["POST"]),
                Route("/rules", self._guard(self._rules)),
                Route("/rules/sets", self._guard(self._sets)),
                Route("/rules/check", self._guard(self._check), methods=["POST"]),
                Route("/rules/apply", self._guard(self._apply), methods=["POST"]),
            ],
            middleware=[Middleware(Headers)],
        )

    async def _index(self, _: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    def _from_here(self, connection: HTTPConnection) -> bool:
        """False for a page of another origin, and for a name of this machine that the drive did not give."""
        host, origin = connection.headers.get("host", ""), connection.headers.get("origin")
        scheme = "https" if self._door.tls else "http"
        known = (
            self._door.tls or host in self._hosts
        )  # TLS checks the name, and its certificate may have several
        return known and origin in (None, f"{scheme}://{host}")

    def _may(self, token: object) -> bool:
        return isinstance(token, str) and secrets.compare_digest(token.encode(), self._door.token.encode())

    def _guard(self, act: Acts) -> Acts:
        """``act`` for those with the token; an InputError becomes a line of text."""

        async def guard(request: Request) -> Response:
            try:
                if not self._from_here(request):
                    raise Refusal(403, "this request comes from another page")
                if not self._may(request.headers.get("authorization", "").removeprefix("Bearer ")):
                    raise Refusal(401, "wrong token: open the address that `trepid drive` printed")
                return await act(request)
            except Refusal as refusal:
                return JSONResponse({"error": refusal.reason}, refusal.status)
            except Conflict as conflict:
                return JSONResponse({"error": str(conflict)}, 409)
            except InputError as error:
                return JSONResponse({"error": str(error)}, 422)

        return guard

    async def _stream(self, socket: WebSocket) -> None:
        """Send the newest state whenever the viewer has drawn the last one."""
        await socket.accept()
        code = await self._greet(socket)
        if code:
            await socket.close(code)
            return
        viewer = Viewer()
        self._streams.add(socket)
        self._hub.viewers.add(viewer)
        self._hub.wanted.set()
        sender = asyncio.create_task(_send_all(socket, viewer))
        try:
            while True:
                await socket.receive_text()
                viewer.acknowledge()
        except (WebSocketDisconnect, KeyError):  # KeyError: a frame that is no text
            pass
        finally:
            self._streams.discard(socket)
            self._hub.viewers.discard(viewer)
            sender.cancel()

    async def end(self, why: str) -> None:
        """End every stream, because the drive has ended; ``why``: in words, which the page shows."""
        for socket in tuple(self._streams):
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it has just been closed
                await socket.close(DRIVE_ENDED, closing_reason(why))

    async def _greet(self, socket: WebSocket) -> int:
        """The code that ends the stream of a viewer without the token; 0 for one with it."""
        if not self._from_here(socket):
            return WRONG_ORIGIN
        try:
            greeting = json.loads(await asyncio.wait_for(socket.receive_text(), GREETING_S))
        except (TimeoutError, ValueError, KeyError, WebSocketDisconnect):
            return WRONG_TOKEN
        if not isinstance(greeting, dict) or not self._may(greeting.get("token")):
            return WRONG_TOKEN
        return TOO_MANY if len(self._hub.viewers) >= MAX_VIEWERS else 0

    async def _press(self, request: Request) -> Response:
        asked = (await _body(request)).get("stop")
        if not isinstance(asked, bool):
            raise Refusal(400, 'expected {"stop": true} or {"stop": false}')
        self._stop.press(asked)
        self._hub.wanted.set()
        return JSONResponse({"sent": True})

    async def _keep(self, _: Request) -> Response:
        if self._one_at_a_time.locked():
            raise Refusal(409, "the last minutes are being kept already")
        async with self._one_at_a_time:
            return JSONResponse({"file": str(await asyncio.to_thread(self._keeping.keep))})

    async def _rules(self, _: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self._desk.show))

    async def _sets(self, _: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self._desk.sets))

    async def _check(self, request: Request) -> Response:
        body = await _body(request)
        return JSONResponse(await asyncio.to_thread(self._desk.check, _text(body, "text")))

    async def _apply(self, request: Request) -> Response:
        body = await _body(request)
        text, sha256 = _text(body, "text"), _text(body, "sha256")
        return JSONResponse(await asyncio.to_thread(self._desk.apply, text, sha256))


def closing_reason(text: str) -> str:
    """``text`` within the length that a closing frame may have (RFC 6455, section 5.5), cut at a word."""
    if len(text.encode()) <= LONGEST_REASON:
        return text
    kept = text.encode()[: LONGEST_REASON - len("…".encode())].decode(errors="ignore")
    return f"{kept.rpartition(' ')[0] or kept}…"


async def _send_all(socket: WebSocket, viewer: Viewer) -> None:
    try:
        while True:
            await socket.send_bytes(await viewer.message())
    except (WebSocketDisconnect, RuntimeError):  # RuntimeError: the stream has been closed
        return


async def _body(request: Request) -> dict[str, Any]:
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > MAX_BODY:
            raise Refusal(413, f"longer than {MAX_BODY // 1024} kB")
    try:
        body = json.loads(data)
    except ValueError as error:
        raise Refusal(400, "the request is no JSON") from error
    if not isinstance(body, dict):
        raise Refusal(400, "the request is no JSON object")
    return body


def _text(body: dict[str, Any], name: str) -> str:
    if not isinstance(body.get(name), str):
        raise Refusal(400, f"{name} is missing")
    return str(body[name])
