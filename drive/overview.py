"""The launcher's report of all processes, once a second, for `trepid status`, recordings and systemd."""

import json
import os
import time
from typing import Any

from sdnotify import SystemdNotifier

from drive.log import DriveLog, number
from trepid.bus import Bus
from trepid.clock import nanoseconds
from trepid.messages import Diagnostic, Health
from trepid.processes.launch import Fleet
from trepid.processes.register import END, PROBLEMS, PROCESS, WAITS
from trepid.processes.settings import LAUNCHER
from trepid.recording.writer import BEGAN
from trepid.topics import DIAGNOSTICS


class Notifier:
    """The notifications of a launcher that runs as a unit with ``Type=notify``."""

    def __init__(self) -> None:
        self._send = SystemdNotifier().notify if os.environ.get("NOTIFY_SOCKET") else lambda _: None
        watchdog_us = os.environ.get("WATCHDOG_USEC", "")
        self._period_s = int(watchdog_us) / 2e6 if watchdog_us.isdecimal() else None
        self._alive_s = -1e9
        self._status = ""

    def ready(self) -> None:
        """The drive has begun."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """The line that `systemctl status` shows."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={text}")

    def alive(self) -> None:
        """The launcher works; sent twice in the time after which the watchdog of systemd ends the drive."""
        now_s = time.monotonic()
        if self._period_s is not None and now_s - self._alive_s >= self._period_s:
            self._alive_s = now_s
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The drive ends."""
        self._send("STOPPING=1")


PERIOD_S = 1.0
ENDED = "the drive has ended"


class Overview:
    """Publishes the state of all processes, and notifies the watchdog of systemd."""

    def __init__(self, bus: Bus, log: DriveLog, fleet: Fleet) -> None:
        self._send = bus.publisher(DIAGNOSTICS)
        self._log, self._fleet = log, fleet
        self._notifier = Notifier()
        self._sent_s = log.now_s() - PERIOD_S
        self._published = ""  # message of the last report
        self._began_s: float | None = None
        self._end = ""  # why the drive has ended
        self._ends: dict[str, str] = {}  # reasons of the ends of processes

    def begin(self, now_s: float) -> None:
        """The drive begins."""
        self._began_s = now_s
        self._notifier.ready()

    def keep_end(self, name: str, reason: str) -> None:
        """Keep the reason of the end of the process ``name``."""
        self._ends[name] = reason

    def close(self, words: str, *, failed: bool) -> None:
        """Publish the last report: ``words`` say why the drive ended, and how it was judged."""
        self._end = words
        self.publish(Health.ERROR if failed else Health.OK, ENDED, words)

    def publish(self, health: Health, message: str, reason: str = "") -> None:
        """Publish when it is due, or when ``message`` has changed. ``reason``, with its numbers, follows it."""
        self._notifier.alive()
        now_s = self._log.now_s()
        if message == self._published and now_s - self._sent_s < PERIOD_S:
            return
        self._published, self._sent_s = message, now_s
        problems, message = message, "; ".join(filter(None, (message, reason)))
        self._notifier.status(message)
        values = [(PROBLEMS, problems)]
        values += [
            (f"{PROCESS}{name}", json.dumps(self._state(name, now_s))) for name in self._fleet.children
        ]
        if self._log.waiting:
            values.append((WAITS, self._log.waiting))
        if self._end:
            values.append((END, self._end))
        if self._began_s is not None:
            values.append((BEGAN, str(nanoseconds(self._began_s))))
        self._send(
            Diagnostic(t_s=now_s, process=LAUNCHER, health=health, message=message, values=tuple(values))
        )

    def stopping(self) -> None:
        """The drive ends."""
        self._notifier.stopping()

    def _state(self, name: str, now_s: float) -> dict[str, Any]:
        """One process as `trepid status` prints it."""
        child, beat = self._fleet.children[name], self._log.diagnostics.get(name)
        values = beat.values if beat else ()
        message = " ".join(beat.message.split()) if beat else self._ends.get(name, "")
        return {
            "name": name,
            "pid": child.popen.pid,
            "alive": child.alive,
            "rate_hz": number(values, "rate_hz"),
            "age_s": round(now_s - beat.t_s, 2) if beat else None,
            "cpu_percent": number(values, "cpu_percent"),
            "restarts": child.restarts,
            "message": message,
            "health": str(beat.health) if beat else "",
            "heartbeat": child.spec.heartbeat,
        }
