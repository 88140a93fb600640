"""Page process: serves the live page of a drive. Nothing that drives waits for it."""

import asyncio
import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp, Message

from cockpit.page.feed import Feed
from cockpit.page.hub import Hub
from cockpit.page.rules import RuleDesk
from cockpit.page.server import KeepDesk, PageServer
from cockpit.page.stop import StopSender
from cockpit.page.view import PageView
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, Settings, load
from trepid.processes.endpoint import listening
from trepid.processes.page_door import PageDoor, page_token
from trepid.processes.process import Process, process
from trepid.topics import CAMERA_COMPRESSED, VEHICLE_STATE

LAST_REPORT_S = 0.3  # the last report of the launcher may arrive after its signal to end
MAX_MESSAGE = 2**16  # of a viewer, which sends its token and acknowledgements


class PageOptions(Settings):
    """What the launcher gives to the process as ``page``."""

    host: str
    port: int
    what: str
    drive: str  # another one for every drive


class Quiet(uvicorn.Server):
    """A server that leaves the signals to the process, and sleeps while there is no request."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.listens, self.ended = asyncio.Event(), asyncio.Event()
        """The server accepts requests; the server is to end."""

    async def main_loop(self) -> None:
        """Wait for the end; that of uvicorn wakes ten times a second, also for the header with the date."""
        await self.on_tick(0)
        self.listens.set()
        await self.ended.wait()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield


def run(me: Process) -> None:
    """Serve until the process is to stop."""
    options = PageOptions.model_validate(me.options["page"])
    feed = Feed(me.bus, me.options["estimators"], jpeg=me.has_publisher(CAMERA_COMPRESSED))
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    keeping = KeepDesk(ring=me.options.get("ring"), recorded=me.options.get("record"))
    view = PageView(
        feed,
        camera,
        vehicle,
        holder=me.publisher(VEHICLE_STATE),
        what=options.what,
        drive=options.drive,
        no_keep=keeping.why_not,
    )
    stop = StopSender(me.bus, me.now_s)
    hub = Hub(feed, view, stop, me.now_s)
    door = PageDoor(options.host, options.port, page_token())
    desk = RuleDesk(Path(me.options["rules"]), Path(me.options["edited_rules"]))
    try:
        asyncio.run(_serve(me, PageServer(door, hub, stop, desk, keeping), door, hub, feed, view))
    finally:
        desk.close()


async def _serve(me: Process, page: PageServer, door: PageDoor, hub: Hub, feed: Feed, view: PageView) -> None:
    application = page.application()
    server = Quiet(_config(application, door))
    with listening(door.host, door.port) as socket:
        serving = asyncio.create_task(server.serve([socket]))
        serving.add_done_callback(lambda _: server.listens.set())  # it does not get there
        await server.listens.wait()
        await _answer_once(application)
        me.ready(values=lambda: (("viewers", str(len(hub.viewers))),))
        while me.running() and not serving.done():
            pause_s = hub.turn()
            me.count_step()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(hub.wanted.wait(), pause_s)
            hub.wanted.clear()
        await page.end(await _last_words(feed, view))
        server.ended.set()
        await serving


async def _last_words(feed: Feed, view: PageView) -> str:
    """Why the drive ended, of the last report of the launcher; "" where none arrives within LAST_REPORT_S."""
    until_s = time.monotonic() + LAST_REPORT_S
    while time.monotonic() < until_s:
        feed.poll()
        if view.end:
            break
        await asyncio.sleep(0.01)
    return view.end


async def _answer_once(application: ASGIApp) -> None:
    """Answer a request of its own: it loads what the first answer needs, while the process starts."""

    async def receive() -> Message:
        return await asyncio.Future[Message]()  # it has no body, and does not disconnect

    async def send(_: Message) -> None:
        return

    await application({"type": "http", "method": "GET", "path": "/", "headers": []}, receive, send)


def _config(application: ASGIApp, door: PageDoor) -> uvicorn.Config:
    keys = door.keys
    return uvicorn.Config(
        application,
        access_log=False,
        log_level="warning",
        lifespan="off",
        server_header=False,
        date_header=False,
        http="h11",
        loop="asyncio",
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=1,
        ssl_certfile=keys[0] if keys else None,
        ssl_keyfile=keys[1] if keys else None,
    )


if __name__ == "__main__":
    with process() as me:
        run(me)
