"""A live page without a drive: its process on a bus of the test, messages of the test's making."""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from message_rig import decision, estimate

from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CONFIG_DIR, ROOT
from trepid.messages import (
    Command,
    CompressedFrame,
    Diagnostic,
    Health,
    LeadVehicle,
    Mode,
    SimTruth,
    SteeringEstimate,
    Timing,
    VehicleState,
)
from trepid.processes.launch import Fleet
from trepid.processes.page_door import PageDoor, page_door
from trepid.processes.register import END, PROCESS, WAITS
from trepid.processes.settings import LAUNCHER, ProcessSpec
from trepid.topics import (
    CAMERA_COMPRESSED,
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    LEAD_VEHICLE,
    SIM_TRUTH,
    STOP_REQUEST,
    TIMING,
    VEHICLE_STATE,
    estimate_topic,
)
from vehicle.driver.stop_button import STOPPED, StopButton

STATIC = ROOT / "cockpit" / "page" / "static"
ESTIMATORS = ("cv", "cnn")
RING = "a drive"  # name of the ring of its last minutes
PERIOD_S = 0.05
LEFT = ((60.0, 230.0), (130.0, 150.0))
RIGHT = ((280.0, 230.0), (190.0, 150.0))


def jpeg(grey: int) -> bytes:
    """A picture of one shade."""
    _, data = cv2.imencode(".jpg", np.full((240, 320, 3), grey, np.uint8))
    return bytes(data)


class Scene:
    """What the messages say; a test changes it at any time."""

    def __init__(self) -> None:
        self.decision: dict[str, Any] = dict(
            mode=Mode.KEEP,
            fear=0.12,
            level="low",
            cause="none",
            rules=("if lane_confidence is low then fear is high", "if speed is high then fear is low"),
            rule_strengths=(0.75, 0.25),
            inputs=("speed", "lane_confidence"),
            input_values=(7.1, None),
            path_source="cv+cnn",
        )
        self.speed_mps: float | None = 7.14
        self.confidence = {"cv": 0.91, "cnn": 0.42}
        self.lead_m: float | None = 23.4
        self.target_mps: float | None = None  # of the commands; None: no command
        self.grey = 60
        self.error_m = 0.07
        self.restarts = 3
        self.picture: bytes | None = None  # instead of the grey one
        self.estimates: dict[str, SteeringEstimate] = {}  # instead of those on the grey one
        self.path: dict[str, Any] = {}  # further fields of the decision
        self.silent = False
        self.own_stop = ""  # what the vehicle process says of a stop of its own
        self.waits = ""  # what the drive waits for before it begins
        self.end = ""  # why the drive has ended
        self.deaf = False  # the vehicle process receives no request of the stop button


class Publisher:
    """Publishes a scene as the processes of a drive do, and obeys the stop button as the vehicle process does."""

    def __init__(self, bus: Any, clock: Any, scene: Scene) -> None:
        self._bus, self._clock, self.scene = bus, clock, scene
        self.button, self.requests = StopButton(standstill_mps=0.05), 0
        self._request = bus.latest(STOP_REQUEST)
        topics = (
            CAMERA_COMPRESSED,
            COMMAND,
            DECISION,
            DIAGNOSTICS,
            LEAD_VEHICLE,
            SIM_TRUTH,
            TIMING,
            VEHICLE_STATE,
        )
        self._send = {topic.key: bus.publisher(topic) for topic in topics}
        self._estimates = {name: bus.publisher(estimate_topic(name)) for name in ESTIMATORS}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._turn = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(PERIOD_S):
            self._turn += 1
            if not self.scene.silent:
                self._publish(self._clock())

    def _publish(self, now_s: float) -> None:
        scene, send = self.scene, self._send
        state = VehicleState(
            t_s=now_s,
            speed_mps=scene.speed_mps,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=0.0,
            driver_override=False,
        )
        request = None if scene.deaf else self._request.take()
        self.requests += request is not None
        self.button.hear(request, state, now_s=now_s)
        if self.button.held and scene.speed_mps is not None:
            state = replace(state, speed_mps=0.0)
            scene.speed_mps = 0.0
        send[VEHICLE_STATE.key](state)
        send[SIM_TRUTH.key](truth(now_s, 10.0 * self._turn * PERIOD_S, scene.error_m))
        for name, publish in self._estimates.items():
            drawn = estimate(
                t_s=now_s,
                estimator=name,
                confidence=scene.confidence[name],
                left_boundary_px=LEFT,
                right_boundary_px=RIGHT,
            )
            publish(replace(scene.estimates.get(name, drawn), t_s=now_s))
        send[LEAD_VEHICLE.key](
            LeadVehicle(t_s=now_s, distance_m=scene.lead_m, lateral_m=0.0, speed_mps=5.0, confidence=0.9)
        )
        send[DECISION.key](decision(now_s, **{"t_s": now_s, **scene.decision, **scene.path}))
        if scene.target_mps is not None:
            send[COMMAND.key](
                Command(t_s=now_s, road_wheel_angle_rad=0.0, speed_mps=scene.target_mps, accel_mps2=0.0)
            )
        if self._turn % 2 == 0:
            send[CAMERA_COMPRESSED.key](CompressedFrame(t_s=now_s, jpeg=scene.picture or jpeg(scene.grey)))
        if self._turn % 10 == 0:
            self._report(now_s)

    def _report(self, now_s: float) -> None:
        send, scene = self._send, self.scene
        row = {
            "name": "vehicle", "pid": 1, "alive": True, "rate_hz": 100.0, "age_s": 0.3, "cpu_percent": 12.5,
            "restarts": scene.restarts, "message": "", "health": "ok", "heartbeat": True,
        }  # fmt: skip
        lost = {**row, "name": "cnn", "alive": False, "message": "was killed by SIGKILL", "rate_hz": None}
        values = (
            (WAITS, scene.waits),
            (END, scene.end),
            (f"{PROCESS}vehicle", json.dumps(row)),
            (f"{PROCESS}cnn", json.dumps(lost)),
        )
        send[DIAGNOSTICS.key](
            Diagnostic(t_s=now_s, process=LAUNCHER, health=Health.OK, message="driving", values=values)
        )
        beat = Diagnostic(
            t_s=now_s,
            process="vehicle",
            health=Health.OK,
            message=STOPPED * self.button.held or scene.own_stop,
            values=(),
        )
        send[DIAGNOSTICS.key](beat)
        frames = (now_s - 0.1, now_s - 0.06)
        send[TIMING.key](
            Timing(
                t_s=now_s,
                process="vehicle",
                frame_s=frames,
                published_s=frames,
                received_s=frames,
                began_s=frames,
                sent_s=(frames[0] + 0.020, frames[1] + 0.022),
            )
        )


def truth(now_s: float, x_m: float, error_m: float) -> SimTruth:
    """The car at ``x_m`` on a straight road."""
    zero = dict.fromkeys(
        (
            "y_m",
            "yaw_rad",
            "heading_error_rad",
            "curvature_1pm",
            "lateral_accel_mps2",
            "longitudinal_accel_mps2",
        ),
        0.0,
    )
    absent = dict.fromkeys(("lead_gap_m", "lead_x_m", "lead_y_m", "lead_yaw_rad"))
    counts = dict.fromkeys(("departures", "interventions", "collisions"), 0)
    return SimTruth(
        t_s=now_s, x_m=x_m, station_m=x_m, lateral_offset_m=error_m, lane_width_m=3.3, section="road",
        finished=False, **zero, **absent, **counts,
    )  # fmt: skip


class LivePage:
    """A page process and its bus."""

    def __init__(self, rules: Path, door: PageDoor | None = None, *, what: str = "a test") -> None:
        self.rules, self.what = rules, what
        self._offset_ns, self.endpoint = epoch_offset_ns(), free_endpoint()
        self.clock = epoch_clock(self._offset_ns)
        self.door: PageDoor = door or page_door("127.0.0.1", 0)
        self._fleet: Fleet | None = None

    @contextmanager
    def bus(self) -> Iterator[Any]:
        """The bus of the launcher."""
        with open_bus("car", self.clock, listen=self.endpoint) as bus:
            yield bus

    def start(self) -> None:
        """Start the page process, and wait until it answers."""
        spec = ProcessSpec(
            "page",
            "cockpit.page.node",
            {
                "page": {
                    "host": self.door.host,
                    "port": self.door.port,
                    "what": self.what,
                    "drive": self.endpoint,
                },
                "ring": RING,
                "estimators": ESTIMATORS,
                "rules": str(self.rules),
                "edited_rules": str(self.rules),
            },
            publishes=(STOP_REQUEST.key,),
        )
        others = {"camera": (CAMERA_COMPRESSED.key,), "vehicle": (VEHICLE_STATE.key,)}  # which do not run
        fleet = Fleet((spec,), vehicle_name="car", endpoint=self.endpoint, clock_offset_ns=self._offset_ns)
        fleet._session["publishes"] |= others
        fleet.__enter__()
        self._fleet = fleet
        deadline_s = time.monotonic() + 20
        while time.monotonic() < deadline_s:
            try:
                if self.request("GET", "/", token=None)[0] == 200:
                    return
            except OSError:
                time.sleep(0.05)
        raise AssertionError(fleet.children["page"].stderr_tail())

    def stop(self) -> None:
        """End the page process."""
        if self._fleet is not None:
            self._fleet.stop()
            self._fleet = None

    @property
    def pid(self) -> int:
        """Of the page process."""
        assert self._fleet is not None
        return self._fleet.children["page"].popen.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def request(
        self, method: str, path: str, body: object = None, *, token: str | None = "", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and content of a request; ``token`` "": the right one, None: none."""
        connection = http.client.HTTPConnection("127.0.0.1", self.door.port, timeout=60)
        given = {} if token is None else {"Authorization": f"Bearer {token or self.door.token}"}
        data = None if body is None else body if isinstance(body, bytes) else json.dumps(body)
        try:
            connection.request(method, path, data, {**given, **headers})
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()


def rule_copy(folder: Path) -> Path:
    """A rule file that a test may replace."""
    copied = folder / "fear.yaml"
    copied.write_text((CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    return copied
