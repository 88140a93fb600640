"""The tables of stages by kind: a pipeline names them, in the order of the kinds.

Signatures by kind. The settings of a stage are its keyword-only parameters. A stage with memory is a class: its
settings are those of its constructor, and its ``step`` is called.

============  ==========================================================================================
``prepare``   ``(image, view) -> image`` of the same size
``warp``      ``(image, view) -> (image, view)``: another picture of the same road
``region``    ``(view, predicted, speed_mps) -> Region``: the picture is cut to its box, features to its mask
``features``  ``(image, view) -> Features``; several are joined by "and"
``outliers``  ``(evidence) -> Features``
``model``     ``(evidence) -> Boundaries``
``track``     ``step(boundaries, motion) -> Boundaries``
``state``     ``(boundaries, view) -> MeasuredLane | None``
``steer``     ``(lane, wheelbase_m, lookahead_m) -> float``: the road-wheel angle [rad], + left, of a lane state
``rule``      ``(boundaries, view, dt_s) -> RuleAngle | None``: a printed steering rule
============  ==========================================================================================

``view`` of ``state`` and ``rule`` is that of the whole working image. ``prepare``, ``warp`` and ``region`` may come
in any order before the features; ``track`` may be left out; several trackers are chained. A pipeline has a
``steer`` or a ``rule``, not both; without either it steers by ``pursuit``. The estimate of a pipeline with a
``rule`` is of kind ``angle``: its lane state only goes into its confidence.
"""

from collections.abc import Callable
from typing import Any

from perception.techniques.boundaries import arcs, curves, lines, orientation, outliers, ransac
from perception.techniques.image import ants, colour, edges, light, region, shadow, stripes, surface, warp
from perception.techniques.steering import (
    abdelrahman,
    centre_line,
    kalman,
    lane,
    sampled,
    sujatha,
    umamaheswari,
)

KINDS: dict[str, dict[str, Callable[..., Any]]] = {
    "prepare": {
        "grey": colour.grey,
        "channel": colour.channel,
        "adaptive_grey": colour.adaptive_grey,
        "binary": colour.binary,
        "gaussian": light.gaussian,
        "gaussian_auto": light.gaussian_auto,
        "median": light.median,
        "median_auto": light.median_auto,
        "high_pass": light.high_pass,
        "clahe": light.clahe,
        "low_light": light.low_light,
        "match_histogram": light.match_histogram,
        "without_shadows": shadow.without_shadows,
        "wavelet": stripes.wavelet,
    },
    "warp": {"area_resize": warp.area_resize, "bird_eye": warp.bird_eye, "bird_eye_self": warp.BirdEyeSelf},
    "region": {
        "roi_fixed": region.roi_fixed,
        "roi_tracked": region.roi_tracked,
        "roi_speed": region.roi_speed,
    },
    "features": {
        "canny": edges.canny,
        "canny_auto": edges.canny_auto,
        "canny_ants": ants.canny_ants,
        "sobel": edges.sobel,
        "prewitt": edges.prewitt,
        "edlines": edges.edlines,
        "dark_bright_dark": stripes.dark_bright_dark,
        "top_hat": stripes.top_hat,
        "oriented": stripes.oriented,
        "paint_colour": stripes.paint_colour,
        "mser_blue": stripes.mser_blue,
        "brightness": surface.brightness,
        "patch_colour": surface.patch_colour,
        "texture": surface.texture,
        "gabor": orientation.gabor,
    },
    "outliers": {
        "near_prediction": outliers.near_prediction,
        "along_road": outliers.along_road,
        "as_wide_as_paint": outliers.as_wide_as_paint,
        "middle_to_side": outliers.middle_to_side,
        "clusters": outliers.clusters,
        "patch_component": outliers.patch_component,
        "outline": outliers.outline,
    },
    "model": {
        "hough": lines.hough,
        "hough_standard": lines.hough_standard,
        "ransac_line": ransac.ransac_line,
        "ransac_parabola": ransac.ransac_parabola,
        "ransac_bspline": ransac.ransac_bspline,
        "ransac_bezier": ransac.ransac_bezier,
        "straight_curve": ransac.straight_curve,
        "near_line_far_parabola": curves.near_line_far_parabola,
        "histogram_cubic": curves.histogram_cubic,
        "hyperbola": curves.hyperbola,
        "arcs": arcs.arcs,
        "pchip": curves.pchip,
        "dominant_edges": orientation.dominant_edges,
    },
    "track": {
        "kalman": kalman.Kalman,
        "extended_kalman": kalman.ExtendedKalman,
        "unscented_kalman": kalman.UnscentedKalman,
        "particles": sampled.Particles,
        "bayes": sampled.Bayes,
    },
    "state": {"exact_pair": lane.exact_pair, "ground_curve": lane.ground_curve, "arc_lane": arcs.arc_lane},
    "steer": {"pursuit": lane.pursuit},
    "rule": {
        "dev": centre_line.dev,
        "tu": centre_line.Tu,
        "sujatha": sujatha.Sujatha,
        "umamaheswari": umamaheswari.Umamaheswari,
        "abdelrahman": abdelrahman.Abdelrahman,
    },
}
