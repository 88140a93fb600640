"""The tables of stages by kind: a pipeline names them, in the order of the kinds.

What a stage of each kind is given and gives; its settings are its keyword-only parameters. A stage that must
remember something is a class: its settings are those of its constructor, and its ``step`` is called.

============  ==========================================================================================
``prepare``   ``(image, view) -> image`` of the same size
``warp``      ``(image, view) -> (image, view)``: another picture of the same road
``region``    ``(view, predicted, speed_mps) -> Region``: the picture is cut to its box, features to its mask
``features``  ``(image, view) -> Features``; several: what all of them see
``outliers``  ``(features, view, predicted) -> Features``
``model``     ``(features, view, predicted, rng) -> Boundaries``
``track``     ``step(boundaries, motion) -> Boundaries``
``state``     ``(boundaries, view) -> Lane | None``
``steer``     ``(boundaries, lane, view, wheelbase_m, dt_s) -> float | None`` road-wheel angle [rad], + left
============  ==========================================================================================

``predicted`` are the boundaries of the last frame moved to where the vehicle is now; None when there are none.
``view`` of ``state`` and ``steer`` is that of the whole working image. ``prepare``, ``warp`` and ``region`` may
come in any order before the features; ``track`` and ``steer`` may be left out.
"""

from collections.abc import Callable
from typing import Any

from perception.techniques.colour import grey
from perception.techniques.edges import canny
from perception.techniques.lane import exact_pair
from perception.techniques.lines import hough
from perception.techniques.region import roi_fixed
from perception.techniques.smoothing import gaussian
from perception.techniques.steer import pursuit

Table = dict[str, Callable[..., Any]]

PREPARE: Table = {"grey": grey, "gaussian": gaussian}
WARP: Table = {}
REGION: Table = {"roi_fixed": roi_fixed}
FEATURES: Table = {"canny": canny}
OUTLIERS: Table = {}
MODEL: Table = {"hough": hough}
TRACK: Table = {}
STATE: Table = {"exact_pair": exact_pair}
STEER: Table = {"pursuit": pursuit}

KINDS: dict[str, Table] = {
    "prepare": PREPARE,
    "warp": WARP,
    "region": REGION,
    "features": FEATURES,
    "outliers": OUTLIERS,
    "model": MODEL,
    "track": TRACK,
    "state": STATE,
    "steer": STEER,
}
