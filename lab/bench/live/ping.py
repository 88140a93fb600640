"""Bare Zenoh beside a drive: the same settings, number of subscribers and size of payload, with nothing else.

``python -m lab.bench.live.ping '<Part as JSON>'`` is one process of it. The payload begins with the time of
publication; a receiver notes the time of Zenoh's call, as :class:`trepid.bus.Mailbox` does.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from trepid.bus import free_endpoint, listen_to, open_session
from trepid.config import ROOT, Settings
from trepid.processes.timing import Summary, summary

SIZES = {"image": 320 * 240 * 3 + 100, "message": 1000}
"""Bytes of a camera frame, and of an estimate."""
STAMP_BYTES = 8
SETTLE_S = 1.0  # sessions connect


class Part(Settings):
    """One process of the ping: the sender, with a rate, or a receiver."""

    endpoint: str
    rate_hz: float | None = None  # None: a receiver


class Ping:
    """One sender and some receivers that run until :meth:`results`."""

    def __init__(self, receivers: int, rate_hz: float) -> None:
        endpoint = free_endpoint()
        self._sender = _start(Part(endpoint=endpoint, rate_hz=rate_hz))
        self._receivers = [_start(Part(endpoint=endpoint)) for _ in range(receivers)]

    def results(self) -> dict[str, Summary | None]:
        """Publication to arrival by kind of payload, over all receivers [ms]; ends the processes."""
        times: dict[str, list[float]] = {name: [] for name in SIZES}
        for popen in self._receivers:
            out, _ = popen.communicate(input="", timeout=10)
            for name, durations_s in json.loads(out).items():
                times[name] += durations_s
        return {name: summary(durations_s) for name, durations_s in times.items()}

    def close(self) -> None:
        """End all processes."""
        for popen in (self._sender, *self._receivers):
            popen.kill()
            popen.wait()
            for pipe in (popen.stdin, popen.stdout):
                if pipe is not None:
                    pipe.close()


@contextmanager
def pinging(receivers: int, *, rate_hz: float) -> Iterator[Ping]:
    """A ping that runs beside the body."""
    ping = Ping(receivers, rate_hz)
    try:
        yield ping
    finally:
        ping.close()


def _start(part: Part) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "lab.bench.live.ping", part.model_dump_json()]
    return subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def send(part: Part) -> None:
    """Publish payloads of all sizes, one after the other, until killed."""
    assert part.rate_hz is not None
    payloads = {name: np.random.default_rng(0).bytes(size - STAMP_BYTES) for name, size in SIZES.items()}
    with open_session(listen=part.endpoint) as session:
        publishers = {name: session.declare_publisher(f"ping/{name}", express=True) for name in SIZES}
        while True:
            for name, payload in payloads.items():
                time.sleep(1 / part.rate_hz / len(payloads))
                stamp = time.monotonic_ns().to_bytes(STAMP_BYTES, "little")
                publishers[name].put(stamp + payload)


def receive(part: Part) -> None:
    """Note arrivals until standard input closes, then print the durations [s]."""
    durations_s: dict[str, list[float]] = {name: [] for name in SIZES}

    def note_arrivals(name: str) -> Any:
        arrivals: list[tuple[int, Any]] = []

        def put(sample: Any) -> None:
            arrivals.append((time.monotonic_ns(), sample.payload.to_bytes()[:STAMP_BYTES]))

        return put, arrivals

    with open_session(connect=part.endpoint) as session:
        kept = {name: note_arrivals(name) for name in SIZES}
        subscribers = [listen_to(session, f"ping/{name}", put) for name, (put, _) in kept.items()]
        time.sleep(SETTLE_S)
        for _, arrivals in kept.values():
            arrivals.clear()
        sys.stdin.read()
        for name, (_, arrivals) in kept.items():
            durations_s[name] = [
                1e-9 * (at_ns - int.from_bytes(stamp, "little")) for at_ns, stamp in arrivals
            ]
        print(json.dumps(durations_s), flush=True)
        del subscribers


if __name__ == "__main__":
    mine = Part.model_validate_json(sys.argv[1])
    (receive if mine.rate_hz is None else send)(mine)
