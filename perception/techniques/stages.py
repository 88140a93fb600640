"""The tables of stages by kind: a pipeline names them, in the order of the kinds.

Signatures by kind. The settings of a stage are its keyword-only parameters. A stage with memory is a class: its
settings are those of its constructor, and its ``step`` is called.

============  ==========================================================================================
``prepare``   ``(image, view) -> image`` of the same size
``warp``      ``(image, view) -> (image, view)``: another picture of the same road
``region``    ``(view, predicted, speed_mps) -> Region``: the picture is cut to its box, features to its mask
``features``  ``(image, view) -> Features``; several are joined by "and"
``outliers``  ``(features, view, predicted) -> Features``
``model``     ``(features, view, predicted, rng) -> Boundaries``
``track``     ``step(boundaries, motion) -> Boundaries``
``state``     ``(boundaries, view) -> MeasuredLane | None``
``steer``     ``(lane, wheelbase_m) -> float``: the road-wheel angle [rad], + left, of a lane state
``rule``      ``(boundaries, view, dt_s) -> RuleAngle | None``: a printed steering rule
============  ==========================================================================================

``predicted``: the boundaries of the last frame in the present vehicle frame; None without any. ``view`` of
``state`` and ``rule`` is that of the whole working image. ``prepare``, ``warp`` and ``region`` may come in any
order before the features; ``track`` may be left out; several trackers are chained. A pipeline has a ``steer`` or a
``rule``, not both; without either it steers by ``pursuit``. The estimate of a pipeline with a ``rule`` is of kind
``angle``: its lane state only goes into its confidence.
"""

from collections.abc import Callable
from typing import Any

from perception.techniques.boundaries.bezier import ransac_bezier
from perception.techniques.boundaries.curves import (
    histogram_cubic,
    hough_standard,
    hyperbola,
    near_line_far_parabola,
    pchip,
)
from perception.techniques.boundaries.ground_curve import ground_curve
from perception.techniques.boundaries.lines import hough
from perception.techniques.boundaries.orientation import dominant_edges, gabor
from perception.techniques.boundaries.outliers import (
    along_road,
    as_wide_as_paint,
    clusters,
    middle_to_side,
    near_prediction,
    outline,
    patch_component,
)
from perception.techniques.boundaries.ransac import (
    ransac_bspline,
    ransac_line,
    ransac_parabola,
    straight_curve,
)
from perception.techniques.image.colour import adaptive_grey, binary, channel, grey
from perception.techniques.image.edges import canny, canny_auto, edlines, prewitt, sobel
from perception.techniques.image.light import clahe, low_light, match_histogram
from perception.techniques.image.region import roi_fixed, roi_speed, roi_tracked
from perception.techniques.image.shadow import without_shadows
from perception.techniques.image.smoothing import gaussian, gaussian_auto, high_pass, median, median_auto
from perception.techniques.image.stripes import (
    dark_bright_dark,
    mser_blue,
    oriented,
    paint_colour,
    top_hat,
    wavelet,
)
from perception.techniques.image.surface import brightness, patch_colour, texture
from perception.techniques.image.warp import BirdEyeSelf, area_resize, bird_eye
from perception.techniques.steering.abdelrahman import Abdelrahman
from perception.techniques.steering.dev import dev
from perception.techniques.steering.lane import exact_pair, pursuit
from perception.techniques.steering.sujatha import Sujatha
from perception.techniques.steering.tu import Tu
from perception.techniques.steering.umamaheswari import Umamaheswari
from perception.techniques.tracking.kalman import Extended, Kalman, Unscented
from perception.techniques.tracking.sampled import Bayes, Particles

Table = dict[str, Callable[..., Any]]

PREPARE: Table = {
    "grey": grey,
    "channel": channel,
    "adaptive_grey": adaptive_grey,
    "binary": binary,
    "gaussian": gaussian,
    "gaussian_auto": gaussian_auto,
    "median": median,
    "median_auto": median_auto,
    "high_pass": high_pass,
    "clahe": clahe,
    "low_light": low_light,
    "match_histogram": match_histogram,
    "without_shadows": without_shadows,
    "wavelet": wavelet,
}
WARP: Table = {"area_resize": area_resize, "bird_eye": bird_eye, "bird_eye_self": BirdEyeSelf}
REGION: Table = {"roi_fixed": roi_fixed, "roi_tracked": roi_tracked, "roi_speed": roi_speed}
FEATURES: Table = {
    "canny": canny,
    "canny_auto": canny_auto,
    "sobel": sobel,
    "prewitt": prewitt,
    "edlines": edlines,
    "dark_bright_dark": dark_bright_dark,
    "top_hat": top_hat,
    "oriented": oriented,
    "paint_colour": paint_colour,
    "mser_blue": mser_blue,
    "brightness": brightness,
    "patch_colour": patch_colour,
    "texture": texture,
    "gabor": gabor,
}
OUTLIERS: Table = {
    "near_prediction": near_prediction,
    "along_road": along_road,
    "as_wide_as_paint": as_wide_as_paint,
    "middle_to_side": middle_to_side,
    "clusters": clusters,
    "patch_component": patch_component,
    "outline": outline,
}
MODEL: Table = {
    "hough": hough,
    "hough_standard": hough_standard,
    "ransac_line": ransac_line,
    "ransac_parabola": ransac_parabola,
    "ransac_bspline": ransac_bspline,
    "ransac_bezier": ransac_bezier,
    "straight_curve": straight_curve,
    "near_line_far_parabola": near_line_far_parabola,
    "histogram_cubic": histogram_cubic,
    "hyperbola": hyperbola,
    "pchip": pchip,
    "dominant_edges": dominant_edges,
}
TRACK: Table = {
    "kalman": Kalman,
    "extended_kalman": Extended,
    "unscented_kalman": Unscented,
    "particles": Particles,
    "bayes": Bayes,
}
STATE: Table = {"exact_pair": exact_pair, "ground_curve": ground_curve}
STEER: Table = {"pursuit": pursuit}
RULE: Table = {
    "dev": dev,
    "tu": Tu,
    "sujatha": Sujatha,
    "umamaheswari": Umamaheswari,
    "abdelrahman": Abdelrahman,
}

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
    "rule": RULE,
}
