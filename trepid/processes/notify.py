"""Notifications to systemd (sd_notify(3)): readiness, state and watchdog; nothing without systemd."""

import os
import time

from sdnotify import SystemdNotifier


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
