import cv2
import numpy as np
import pytest
from technique_rig import (
    ASPHALT,
    CAMERA,
    LANE,
    VIEW,
    WHITE,
    YELLOW,
    bars,
    below_horizon,
    f1,
    grow,
    paint,
    precision,
    recall,
    ribbon,
    road,
    straight_boundaries,
)

from perception.techniques.boundaries import outliers
from perception.techniques.image import edges, stripes, surface
from perception.techniques.image.colour import grey
from perception.techniques.image.light import gaussian
from perception.techniques.image.picture import Boundaries, Evidence, FeatureKind, Features, PixelBox
from perception.techniques.image.warp import bird_eye
from perception.techniques.stages import KINDS

FEATURES, OUTLIERS = KINDS["features"], KINDS["outliers"]
RNG = np.random.default_rng(5)
WIDE = 4.0  # verge: asphalt on both sides of the paint
PLAIN = np.full((240, 320, 3), 100, np.uint8)
ROAD = np.isfinite(VIEW.pixel_m)


def response(find, image, **how):
    """The response of ``find`` to the part below the horizon, in the whole picture."""
    lower, view = below_horizon(image)
    whole = np.zeros(image.shape[:2], np.float32)
    whole[-lower.shape[0] :] = find(lower, view, **how).response
    return whole


def road_of(lane=LANE, width_m=4.6, verge=None):
    """An unmarked road in grass, or in a verge of that colour, and its mask."""
    image = road(lane, width_m - 0.01, left=None, right=None, verge_m=0.0)
    truth = np.zeros((240, 320, 3), np.uint8)
    for side in (1, -1):
        ribbon(truth, CAMERA, lane, side * width_m / 4, width_m / 2, (255, 255, 255))
    if verge is not None:
        image[(truth[:, :, 0] <= 127) & ROAD[:, None]] = verge
    return image, truth[:, :, 0] > 127


@pytest.mark.parametrize("name", FEATURES)
@pytest.mark.parametrize("image", [PLAIN, PLAIN[:, :, 0]], ids=["colour", "grey"])
def test_an_even_picture_has_no_line(name, image):
    seen = FEATURES[name](image, VIEW)
    assert seen.response.shape == (240, 320) and np.isfinite(seen.response).all()
    if seen.kind is FeatureKind.LINE:
        assert not seen.response.any()


@pytest.mark.parametrize("name", FEATURES)
def test_features_of_the_mirrored_picture_are_mirrored(name):
    """Within a pixel: the middle of an even number of columns lies between two of them."""
    camera = CAMERA.model_copy(update=dict(cx_px=159.5))
    view = type(VIEW)(camera, 320, 240, camera.pixel_from_road_matrix)
    image = cv2.GaussianBlur(road(LANE, left=YELLOW, verge_m=WIDE), (0, 0), 0.8)
    here = FEATURES[name](image, view).response > 0.5
    there = FEATURES[name](np.ascontiguousarray(image[:, ::-1]), view).response[:, ::-1] > 0.5
    assert (here & grow(there)).sum() >= 0.95 * here.sum()
    assert (there & grow(here)).sum() >= 0.95 * there.sum()


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("canny", 0.95),
        ("canny_auto", 0.95),
        ("sobel", 0.95),
        ("prewitt", 0.95),
        ("edlines", 0.9),
        ("dark_bright_dark", 0.92),
        ("top_hat", 0.95),
        ("paint_colour", 0.95),
        ("mser_blue", 0.9),
    ],
)
def test_painted_lines_are_found_and_little_else(name, least):
    seen = response(FEATURES[name], road(LANE, left=YELLOW, verge_m=WIDE))
    truth = paint(left=YELLOW, verge_m=WIDE)
    assert recall(seen, truth) >= least
    assert precision(seen, truth, reach_m=15) > 0.85


@pytest.mark.parametrize("name", ["dark_bright_dark", "top_hat", "oriented"])
def test_a_stripe_filter_responds_to_ten_centimetres_of_paint_and_to_no_step(name):
    step = np.where(np.arange(320) < 160, 70, 170).astype(np.uint8)[None].repeat(240, axis=0)
    stripe = np.full((240, 320, 3), 90, np.uint8)
    ribbon(stripe, CAMERA, (0.0, 0.0, 0.0, 0.0), 1.0, 0.10, WHITE)
    pictures = {"step": np.dstack([step] * 3), "stripe": stripe}
    found = {}
    for kind, image in pictures.items():
        picture, view = bird_eye(image, VIEW, reach_m=14.0) if name == "oriented" else below_horizon(image)
        high = FEATURES[name](picture, view).response
        high = np.where(view.seen, high, 0) if view.seen is not None else high
        found[kind] = high.max()
        if kind == "stripe":
            rows, columns = np.nonzero(high)
            assert np.median(view.ground(np.column_stack([columns, rows]))[:, 1]) == pytest.approx(
                1.0, abs=0.06
            )
    # A second derivative has half a stripe's response next to a step.
    assert found["step"] < (0.5 if name == "oriented" else 0.25) * found["stripe"]


def test_the_width_of_a_stripe_is_that_on_the_road():
    """The same filter in metres responds most to 12 cm, near and far."""
    widths = (0.06, 0.12, 0.5)
    for reach in ((3.3, 4.2), (4.2, 5.5)):
        rows = (VIEW.ahead_m > reach[0]) & (VIEW.ahead_m < reach[1])
        highest = []
        for width in widths:
            image = np.full((240, 320, 3), 90, np.uint8)
            ribbon(image, CAMERA, (0.0, 0.0, 0.0, 0.0), 1.0, width, WHITE)
            highest.append(np.median(stripes.dark_bright_dark(image, VIEW).response[rows].max(axis=1)))
        assert highest[1] > highest[0] and highest[1] > highest[2]


@pytest.mark.parametrize("name", ["sobel", "prewitt"])
def test_a_shadow_across_the_road_has_no_upright_edge(name):
    level = np.full((240, 320, 3), ASPHALT, np.uint8)
    assert not FEATURES[name](bars(level), VIEW).response.any()
    assert edges.canny_auto(bars(level), VIEW).response.any(), "the full gradient sees it"


def test_sobel_and_prewitt_measure_grey_levels_per_pixel():
    ramp = np.tile(np.arange(0, 240, 3), (240, 1)).astype(np.uint8)
    ramp[:, 40] += 6
    for name in ("sobel", "prewitt"):
        seen = FEATURES[name](ramp, VIEW.crop(PixelBox(0, 240, 0, 80)), least=1.0).response
        assert seen[100, 39] == pytest.approx(6.0, abs=0.01)


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.0])
def test_automatic_thresholds_follow_the_light(gain):
    image = (road(LANE, verge_m=WIDE) * gain).astype(np.uint8)
    seen = response(edges.canny_auto, cv2.GaussianBlur(image, (0, 0), 1.1))
    assert f1(seen, paint(verge_m=WIDE)) > 0.9


def test_fixed_thresholds_do_not_follow_the_light():
    image = (road(LANE, verge_m=WIDE) * 0.25).astype(np.uint8)
    assert recall(response(edges.canny, cv2.GaussianBlur(image, (0, 0), 1.1)), paint(verge_m=WIDE)) < 0.5


def test_white_and_yellow_paint_in_shadow_are_stable_regions():
    image = road(LANE, left=YELLOW, verge_m=WIDE)
    shaded = bars(image, from_m=5.0, to_m=11.0)
    seen = response(stripes.mser_blue, shaded)
    assert recall(seen, paint(left=YELLOW, verge_m=WIDE, reach_m=15.0)) >= 0.9


def test_the_oriented_filter_finds_lines_from_above():
    image, view = bird_eye(road(LANE, verge_m=WIDE), VIEW, reach_m=20.0)
    seen = np.where(view.seen, stripes.oriented(image, view).response, 0)
    rows, columns = np.nonzero(seen)
    y = view.ground(np.column_stack([columns, rows]))
    away = np.minimum(*(np.abs(y[:, 1] - side.at(y[:, 0])) for side in sides(LANE)))
    assert np.nanquantile(away, 0.9) < 0.15
    assert all((np.abs(y[:, 1] - side.at(y[:, 0])) < 0.15).any() for side in sides(LANE))


def sides(lane):
    both = straight_boundaries(lane[0], lane[1], far_m=60.0, near_m=1.0)
    return both.left, both.right


@pytest.mark.parametrize("gain", [0.4, 1.0, 1.5])
@pytest.mark.parametrize("name", ["brightness", "patch_colour"])
def test_the_road_ahead_is_found_without_markings_in_any_light(name, gain):
    """Overlap of at least 0.9 with the true road up to 25 m (B13, B15)."""
    soil = (90, 140, 190)  # grass is as bright as asphalt: brightness alone does not separate them
    image, truth = road_of(verge=soil if name == "brightness" else None)
    image = np.clip(image * gain, 0, 255).astype(np.uint8)
    seen = FEATURES[name](image, VIEW)
    found = outliers.patch_component(Evidence(seen, VIEW)).response > 0.5
    near = (VIEW.ahead_m < 25)[:, None] & np.ones((240, 320), bool)
    assert (found & truth & near).sum() / ((found | truth) & near).sum() > 0.9


def test_texture_separates_gravel_and_asphalt():
    image, truth = road_of()
    rough = image.astype(float)
    rough[~truth] = 105 + RNG.normal(0, 30, (np.count_nonzero(~truth), 3))
    rough = np.clip(rough, 0, 255).astype(np.uint8)
    seen = surface.texture(rough, VIEW).response
    inner = ~grow(~truth, 6) & ROAD[:, None]
    outer = ~grow(truth, 6) & ROAD[:, None]
    assert seen[inner].mean() > 0.8 and seen[outer].mean() < 0.2
    # Brightness alone cannot: half of the gravel is as bright as the road.
    assert surface.brightness(rough, VIEW).response[outer].mean() > 0.3


def line_features(image):
    lower, view = below_horizon(image)
    return edges.canny(gaussian(grey(lower, view), view), view), view


def whole(seen):
    out = np.zeros((240, 320), np.float32)
    out[-seen.response.shape[0] :] = seen.response
    return out


@pytest.mark.parametrize("name", [name for name in OUTLIERS if name not in ("patch_component", "outline")])
def test_outlier_stages_only_remove_and_keep_the_lane(name):
    image = road(LANE, verge_m=WIDE)
    seen, view = line_features(image)
    kept = OUTLIERS[name](Evidence(seen, view, Boundaries(*sides(LANE))))
    assert ((kept.response > 0) <= (seen.response > 0)).all() and kept.kind is FeatureKind.LINE
    assert recall(whole(kept), paint(verge_m=WIDE)) > 0.95


@pytest.mark.parametrize("name", OUTLIERS)
def test_outlier_stages_accept_an_empty_map(name):
    for kind in FeatureKind:
        empty = Features(np.zeros((240, 320), np.float32), kind)
        assert not OUTLIERS[name](Evidence(empty, VIEW)).response.any()


@pytest.mark.parametrize("name", ["along_road", "clusters"])
def test_pieces_across_the_road_are_removed(name):
    image = road(LANE, verge_m=WIDE)
    cv2.rectangle(image, (120, 150), (200, 152), (20, 20, 20), -1)
    seen, view = line_features(image)
    kept = whole(OUTLIERS[name](Evidence(seen, view)))
    assert whole(seen)[145:158, 125:195].any()
    assert not kept[145:158, 125:195].any() or name == "clusters"


def test_arrows_are_wider_than_paint():
    image = road(LANE, verge_m=WIDE)
    ribbon(image, CAMERA, (0.0, 0.0, 0.0, 0.0), 0.3, 0.8, WHITE, lambda s: 8 <= s < 12)
    lower, view = below_horizon(image)
    bright = Features(np.where(grey(lower, view) > 160, np.uint8(255), np.uint8(0)), FeatureKind.LINE)
    kept = whole(outliers.as_wide_as_paint(Evidence(bright, view)))
    rows = (VIEW.ahead_m > 8.5) & (VIEW.ahead_m < 11)
    columns = slice(140, 165)
    assert whole(bright)[rows][:, columns].mean() > 100 and not kept[rows][:, columns].any()
    assert recall(kept, paint(verge_m=WIDE)) > 0.9


def test_the_scan_from_the_middle_takes_the_inner_line_of_several():
    image = road(LANE, verge_m=WIDE)
    ribbon(image, CAMERA, LANE, 3.4 / 2 + 0.6, 0.12, WHITE)  # a second line outside of the left one
    seen, view = line_features(image)
    kept = whole(outliers.middle_to_side(Evidence(seen, view)))
    rows, columns = np.nonzero(kept)
    y = VIEW.ground(np.column_stack([columns, rows]))
    away = np.minimum(*(np.abs(y[:, 1] - side.at(y[:, 0])) for side in sides(LANE)))
    assert np.nanquantile(away[y[:, 0] < 15], 0.95) < 0.2
    assert whole(seen).astype(bool).sum() > 2 * len(rows)


def test_only_features_near_the_prediction_are_kept():
    image = road(LANE, verge_m=WIDE)
    ribbon(image, CAMERA, LANE, 0.0, 0.12, WHITE)  # a false line in the middle of the lane
    seen, view = line_features(image)
    kept = whole(outliers.near_prediction(Evidence(seen, view, Boundaries(*sides(LANE)))))
    truth = paint(verge_m=WIDE)
    assert precision(whole(seen), truth, reach_m=15) < 0.8 < precision(kept, truth, reach_m=15)


def test_the_outline_of_a_region_are_the_edges_of_the_road():
    image, _ = road_of()
    seen = outliers.patch_component(Evidence(surface.patch_colour(image, VIEW), VIEW))
    line = outliers.outline(Evidence(seen, VIEW))
    rows, columns = np.nonzero(line.response)
    near = (VIEW.ahead_m[rows] < 15) & (VIEW.ahead_m[rows] > 4)
    y = VIEW.ground(np.column_stack([columns, rows]))[near]
    both = straight_boundaries(LANE[0], LANE[1], width_m=4.6, far_m=60.0, near_m=1.0)
    away = np.minimum(np.abs(y[:, 1] - both.left.at(y[:, 0])), np.abs(y[:, 1] - both.right.at(y[:, 0])))
    assert line.kind is FeatureKind.LINE and len(y) > 50
    assert np.sqrt(np.mean(away**2)) < 0.15
