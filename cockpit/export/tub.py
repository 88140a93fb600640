"""A drive as a tub of donkeycar, version 2: ``manifest.json``, catalogs of records, and a folder of JPEG images.

One record per frame, one session per piece without pauses. ``user/angle`` is -δ/δ_max, in -1..1 and positive to
the right, from the road-wheel angle δ and the lock δ_max of the car. ``user/throttle`` is the speed as a share of
the greatest in the tub, since drives hold no throttle. ``user/mode`` is ``user`` where a driver steered, else
``local`` (a pilot drove). Layout: datastore_v2.py and tub_v2.py of donkeycar 4 and 5.
"""

import json
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cockpit.export.frames import DrivenFrame
from trepid.images.files import is_upright_jpeg

INPUTS = {
    "cam/image_array": "image_array",
    "user/angle": "float",
    "user/throttle": "float",
    "user/mode": "str",
    "enc/speed": "float",  # [m/s]
}
MAX_RECORDS = 1000  # of a catalog
QUALITY = 95  # of images that were recorded raw, or turned by EXIF


def write_tub(frames: Iterable[DrivenFrame], out: Path, *, lock_rad: float) -> int:
    """Write the tub into the new folder ``out``; return the number of its records."""
    (out / "images").mkdir(parents=True)
    records: list[dict[str, Any]] = []
    for number, frame in enumerate(frames):
        name = f"{number}_cam_image_array_.jpg"
        (out / "images" / name).write_bytes(_upright(frame))
        records.append(_record(number, name, frame, lock_rad))
    top_mps = max((abs(record["enc/speed"]) for record in records if "enc/speed" in record), default=0.0)
    for record in records:
        if "enc/speed" in record:
            record["user/throttle"] = record["enc/speed"] / top_mps if top_mps > 0 else 0.0
    _write_catalogs(out, records)
    return len(records)


def _record(number: int, image: str, frame: DrivenFrame, lock_rad: float) -> dict[str, Any]:
    record = {
        "_index": number,
        "_session_id": f"{datetime.fromtimestamp(frame.t_s, UTC):%y-%m-%d}_{frame.episode}",
        "_timestamp_ms": round(frame.t_s * 1e3),
        "cam/image_array": image,
        "user/angle": float(np.clip(-frame.road_wheel_rad / lock_rad, -1.0, 1.0)),
        "user/mode": "user" if frame.by_driver else "local",
    }
    return record | ({"enc/speed": frame.speed_mps} if math.isfinite(frame.speed_mps) else {})


def _upright(frame: DrivenFrame) -> bytes:
    """The JPEG of a frame: as it was recorded, unless its EXIF turns the pixels, which donkeycar ignores."""
    if frame.jpeg is not None and is_upright_jpeg(frame.jpeg):
        return frame.jpeg
    return cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def _write_catalogs(out: Path, records: list[dict[str, Any]]) -> None:
    created_s = records[0]["_timestamp_ms"] / 1e3 if records else 0.0
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
    ids = list(dict.fromkeys(record["_session_id"] for record in records))
    sessions = {"all_full_ids": ids, "last_id": len(ids) - 1, "last_full_id": ids[-1] if ids else None}
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
