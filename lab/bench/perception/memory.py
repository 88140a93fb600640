"""Peak memory of a process that loads and runs estimators, and the supervisor that judges them (M09).

Each row is a process of its own, which imports what a process of a car does, reads the frames of a lap one by one
and gives them to its estimators. With FEAR it rates the image and decides too, as the supervised car. The first row
reads the same frames and estimates nothing: Python, numpy, OpenCV and the frame.

The peak is ``VmHWM`` of proc(5), which begins anew with the program. The ``ru_maxrss`` of getrusage(2) outlives
exec: a small child of a large process would have the peak of its parent.
"""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from trepid.config import InputError
from trepid.messages import Frame, SteeringEstimate, VehicleState

FRAMES = 250  # of the lap: 10 s
SPEED_MPS, PERIOD_S = 8.0, 0.04
SHAPE = (240, 320, 3)
FEAR = "fear"
ALONE = "frames alone"
ROWS: dict[str, tuple[str, ...]] = {
    ALONE: (),
    "cv": ("cv",),
    "cnn": ("cnn",),
    "cv, cnn": ("cv", "cnn"),
    "cv, cnn under fear": ("cv", "cnn", FEAR),
}
"""Row -> estimators, by name or file, and FEAR."""
IMAGES, YAW_RATES = "images.bin", "yaw_rates.npy"


def bench_memory(*, estimators: tuple[str, ...] = ()) -> dict[str, Any]:
    """Peak resident memory by row of ROWS, and of each of ``estimators``: names, or files of driving networks.

    Raises InputError where a process ends with an error.
    """
    with TemporaryDirectory() as place:
        folder = Path(place)
        write_lap(folder)
        peaks = {
            row: peak_of(folder, names)
            for row, names in {**ROWS, **{Path(name).name: (name,) for name in estimators}}.items()
        }
    return {
        "peak memory of one process": {
            row: {"peak [MiB]": round(peak, 1), "above the frames alone [MiB]": round(peak - peaks[ALONE], 1)}
            for row, peak in peaks.items()
        },
        "frames": FRAMES,
    }


def write_lap(folder: Path) -> None:
    """The first FRAMES frames of the lap, and the yaw rates there [rad/s]."""
    from lab.bench.frames import lap

    rates = []
    with (folder / IMAGES).open("wb") as file:
        for frame, state, *_ in islice(lap(), FRAMES):
            file.write(frame.image.tobytes())
            rates.append(state.yaw_rate_radps)
    np.save(folder / YAW_RATES, np.array(rates))


def peak_of(folder: Path, names: Sequence[str]) -> float:
    """The peak memory [MiB] of a process that runs :func:`run`. Raises InputError when it fails."""
    command = [sys.executable, "-m", __name__, str(folder), *names]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"{', '.join(names) or ALONE}: {done.stderr.strip().splitlines()[-1]}")
    return float(json.loads(done.stdout))


def moments(folder: Path) -> Iterator[tuple[Frame, VehicleState]]:
    """The frames of the folder and the states of the vehicle, one in memory at a time."""
    rates_radps = np.load(folder / YAW_RATES)
    with (folder / IMAGES).open("rb") as file:
        for number, rate_radps in enumerate(rates_radps.tolist()):
            t_s = number * PERIOD_S
            image = np.fromfile(file, np.uint8, count=int(np.prod(SHAPE))).reshape(SHAPE)
            state = VehicleState(
                t_s=t_s,
                speed_mps=SPEED_MPS,
                road_wheel_angle_rad=0.0,
                yaw_rate_radps=rate_radps,
                driver_override=False,
            )
            yield Frame(t_s=t_s, image=image), state


def run(folder: Path, names: Sequence[str]) -> None:
    """Give every frame of the folder to the estimators, and with FEAR to judge and supervisor.

    Raises InputError.
    """
    import cv2

    cv2.setNumThreads(1)
    estimators = {}
    if any(name != FEAR for name in names):
        from perception.estimators import build

        estimators = {name: build(name) for name in names if name != FEAR}
    judge = supervisor = None
    if FEAR in names:
        import perception.sight.judge
        import supervisor.supervisor as supervision

        judge, supervisor = perception.sight.judge.build(), supervision.build()
    for frame, state in moments(folder):
        found: dict[str, SteeringEstimate | None] = {
            name: estimator.step(frame, state, now_s=frame.t_s) for name, estimator in estimators.items()
        }
        if judge is not None and supervisor is not None:
            statistics = judge.step(frame, found.get("cv"), state, now_s=frame.t_s)
            supervisor.step(found, statistics, None, state, now_s=frame.t_s)


def peak_mib() -> float:
    """The most memory [MiB] that this program had resident. Raises InputError on systems without proc(5)."""
    status = Path("/proc/self/status")
    if not status.is_file():
        raise InputError("peak memory is read from /proc/self/status, which Linux has")
    line = next(one for one in status.read_text(encoding="ascii").splitlines() if one.startswith("VmHWM"))
    return float(line.split()[1]) / 1024


if __name__ == "__main__":
    run(Path(sys.argv[1]), sys.argv[2:])
    print(json.dumps(peak_mib()))
