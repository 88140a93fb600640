"""A drive as a tub of donkeycar, version 2: ``manifest.json``, catalogs of records, and a folder of JPEG images.

One record per recorded image. ``user/angle`` is -δ/δ_max, in -1..1 and positive to the right, from the measured
road-wheel angle δ and the lock δ_max of the car. ``user/throttle`` is the measured speed as a share of the greatest
in the recording, since a recording has no throttle. ``user/mode`` is ``user`` where the driver had taken over, else
``local``: a pilot drove. Layout: datastore_v2.py and tub_v2.py of donkeycar 4 and 5.
"""

import json
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeGuard

import cv2
import numpy as np

from cockpit.export.drive import Drive
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import VehicleState
from trepid.topics import VEHICLE_STATE
from trepid.types import Image

INPUTS = {
    "cam/image_array": "image_array",
    "user/angle": "float",
    "user/throttle": "float",
    "user/mode": "str",
    "enc/speed": "float",  # [m/s]
}
MAX_RECORDS = 1000  # of a catalog
QUALITY = 95  # of images that were recorded raw


def write_tub(drive: Drive, out: Path, done: Callable[[float], None]) -> tuple[int, int]:
    """Write the tub into the new folder ``out``; return the numbers of records and of images left out.

    Images without a measured road-wheel angle are left out. Raises InputError when none is left.
    """
    if not drive.image_s:
        raise InputError(f"{drive.path}: holds no camera image, so there is no tub of it")
    lock_rad = load(CONFIG_DIR / "vehicle.yaml", Vehicle).max_road_wheel_angle_rad
    speeds = (state.speed_mps for _, state in drive.recorded.of(VEHICLE_STATE))
    top_mps = max((abs(speed) for speed in speeds if _known(speed)), default=0.0)
    session = f"{datetime.fromtimestamp(drive.zero_s, UTC):%y-%m-%d}_0"
    (out / "images").mkdir(parents=True)
    records: list[dict[str, Any]] = []
    for number, (t_s, image, jpeg) in enumerate(drive.images(), start=1):
        done(number / len(drive.image_s))
        state = drive.newest(VEHICLE_STATE, t_s)
        if state is None or not _known(state.road_wheel_angle_rad):
            continue
        name = f"{len(records)}_cam_image_array_.jpg"
        (out / "images" / name).write_bytes(jpeg or _jpeg(image))
        stamps = {"_index": len(records), "_session_id": session, "_timestamp_ms": round(t_s * 1e3)}
        records.append({**stamps, "cam/image_array": name, **_driven(state, lock_rad, top_mps)})
    if not records:
        raise InputError(f"{drive.path}: no image has a measured road-wheel angle, so there is no tub of it")
    _write_catalogs(out, records, drive.zero_s, session)
    return len(records), len(drive.image_s) - len(records)


def _driven(state: VehicleState, lock_rad: float, top_mps: float) -> dict[str, Any]:
    assert _known(state.road_wheel_angle_rad)  # the caller leaves other frames out
    fields: dict[str, Any] = {
        "user/angle": float(np.clip(-state.road_wheel_angle_rad / lock_rad, -1.0, 1.0)),
        "user/mode": "user" if state.driver_override else "local",
    }
    if _known(state.speed_mps):
        fields["enc/speed"] = state.speed_mps
        fields["user/throttle"] = state.speed_mps / top_mps if top_mps else 0.0
    return fields


def _known(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def _jpeg(image: Image) -> bytes:
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def _write_catalogs(out: Path, records: list[dict[str, Any]], created_s: float, session: str) -> None:
    catalogs: list[str] = []
    for start in range(0, len(records), MAX_RECORDS):
        name = f"catalog_{len(catalogs)}.catalog"
        lines = [_line(record) for record in records[start : start + MAX_RECORDS]]
        (out / name).write_text("".join(lines), encoding="utf-8", newline="")
        about = {
            "created_at": created_s,
            "line_lengths": list(map(len, lines)),
            "path": f"{name}_manifest",
            "start_index": start,
        }
        (out / f"{name}_manifest").write_text(_line(about), encoding="utf-8", newline="")
        catalogs.append(name)
    sessions = {"all_full_ids": [session], "last_id": 0, "last_full_id": session}
    held = {
        "paths": catalogs,
        "current_index": len(records),
        "max_len": MAX_RECORDS,
        "deleted_indexes": [],
    }
    about_tub = {"created_at": created_s, "sessions": sessions}
    parts: tuple[Any, ...] = (list(INPUTS), list(INPUTS.values()), {}, about_tub, held)
    text = "".join(json.dumps(part) + "\n" for part in parts)
    (out / "manifest.json").write_text(text, encoding="utf-8", newline="")


def _line(record: dict[str, Any]) -> str:
    """A line of a catalog as donkeycar writes it; ASCII, so that its length in characters is that in bytes."""
    return json.dumps(record, allow_nan=False, sort_keys=True) + "\n"
