import cv2
import numpy as np
import pytest
from technique_rig import (
    ASPHALT,
    LANE,
    SKY_LIGHT,
    VIEW,
    WHITE,
    YELLOW,
    bars,
    below_horizon,
    f1,
    paint,
    recall,
    road,
)

from perception.techniques.image.colour import adaptive_grey, binary, channel, discriminant, grey, hsi
from perception.techniques.image.edges import canny, canny_auto
from perception.techniques.image.light import (
    auto_sigma_px,
    clahe,
    gaussian,
    gaussian_auto,
    high_pass,
    low_light,
    match_histogram,
    matching,
    median,
    median_auto,
)
from perception.techniques.image.rows import row_means, row_top_hat, width_px
from perception.techniques.image.shadow import reintegrate, shadow_edges, without_shadows
from perception.techniques.image.stripes import wavelet
from trepid.config import InputError

RNG = np.random.default_rng(3)
ROAD = np.isfinite(VIEW.pixel_m)


def test_grey_is_the_luminance_and_keeps_grey_pictures():
    image = road(LANE)
    wanted = image @ np.array([0.114, 0.587, 0.299])
    assert np.abs(grey(image, VIEW) - wanted).max() <= 1
    assert (grey(grey(image, VIEW), VIEW) == grey(image, VIEW)).all()


@pytest.mark.parametrize(
    ("space", "name", "yellow_stands_out"),
    [("hls", "l", False), ("hsv", "s", True), ("lab", "b", True), ("ycbcr", "b", True)],
)
def test_a_channel_separates_the_paint_of_its_space(space, name, yellow_stands_out):
    picture = np.array([[YELLOW, ASPHALT, WHITE]], np.uint8)
    yellow, plain, white = channel(picture, VIEW, space=space, name=name)[0].astype(int)
    assert (abs(yellow - plain) > 40) == yellow_stands_out
    assert (abs(white - plain) < 12) == yellow_stands_out


def test_a_channel_that_a_space_lacks_is_named():
    with pytest.raises(InputError, match="hsv has no channel 'l'; it has h, s, v"):
        channel(road(LANE), VIEW, space="hsv", name="l")


def test_hue_saturation_and_intensity_are_those_of_pure_colours():
    hue, saturation, intensity = hsi(
        np.array([[(0, 0, 255), (0, 255, 0), (255, 0, 0), (90, 90, 90)]], np.uint8)
    )
    assert np.degrees(hue[0, :3]) == pytest.approx([0, 120, -120], abs=1e-3)
    assert saturation[0] == pytest.approx([1, 1, 1, 0], abs=1e-6)
    assert intensity[0] == pytest.approx([1 / 3, 1 / 3, 1 / 3, 90 / 255])


def test_the_two_class_threshold_finds_the_paint():
    lower, view = below_horizon(road(LANE))
    picture = binary(row_top_hat(grey(lower, view), view, 0.25), view)
    truth = paint()[-lower.shape[0] :]
    assert (picture[truth] > 0).mean() > 0.8 and (picture[~truth] > 0).mean() < 0.03


@pytest.mark.parametrize(
    "light", [(1.0, 1.0, 1.0), (0.45, 0.95, 1.0), (1.0, 0.75, 0.5)], ids=["white", "yellow", "blue"]
)
@pytest.mark.parametrize("colour", [WHITE, YELLOW], ids=["white line", "yellow line"])
def test_the_adaptive_projection_has_at_least_1_5_times_the_contrast_of_luminance(light, colour):
    """Contrast in standard deviations of the road (B10: at least 1.5 times that of luminance)."""
    how = dict(left=colour, right=None)
    image = np.clip(road(LANE, **how) * np.array(light), 0, 255).astype(np.uint8)
    truth = paint(**how)
    ground = (VIEW.ahead_m < 20)[:, None] & (np.abs(image - np.array(ASPHALT) * light).max(axis=2) < 14)
    contrasts = []
    for picture in (grey(image, VIEW), adaptive_grey(image, VIEW)):
        values = picture.astype(float)
        contrasts.append((values[truth].mean() - values[ground].mean()) / values[ground].std())
    assert contrasts[1] > 1.5 * contrasts[0] or values[truth].mean() > 250, contrasts


def test_the_discriminant_is_that_of_fisher():
    """Checked by its definition: no other direction has a larger ratio of the scatters between and within."""
    one, other = RNG.normal(0, (1, 4, 9), (400, 3)), RNG.normal((3, 3, 3), (2, 5, 7), (400, 3))
    weights = discriminant(one, other)

    def ratio(w):
        return np.dot(w, one.mean(0) - other.mean(0)) ** 2 / (
            w @ (np.cov(one.T) + np.cov(other.T) + 4 * np.eye(3)) @ w
        )

    assert all(ratio(weights) >= ratio(w) * (1 - 1e-5) for w in RNG.normal(size=(50, 3)))


def test_without_paint_the_adaptive_projection_is_luminance():
    plain = np.full((240, 320, 3), 100, np.uint8)
    assert (adaptive_grey(plain, VIEW) == grey(plain, VIEW)).all()


def test_the_automatic_blur_never_removes_ten_centimetres_at_fifteen_metres():
    sigma_px = auto_sigma_px(VIEW, 0.10, 15.0)
    row = int(np.argmin(np.abs(np.nan_to_num(VIEW.ahead_m, nan=np.inf) - 15)))
    stripe_px = float(width_px(VIEW, 0.10)[row])
    fine = np.zeros(4001)
    fine[2000 - round(50 * stripe_px) : 2000 + round(50 * stripe_px)] = 1  # 100 samples a pixel
    kernel = np.exp(-0.5 * (np.arange(-1500, 1501) / 100 / sigma_px) ** 2)
    assert np.convolve(fine, kernel / kernel.sum(), "same").max() == pytest.approx(0.5, abs=0.02)
    assert (gaussian_auto(road(LANE), VIEW) != road(LANE)).any()


def test_the_automatic_median_keeps_paint_in_every_row_where_it_smooths():
    smooth = median_auto(grey(road(LANE), VIEW), VIEW)
    truth = paint()
    assert smooth[truth].mean() > 0.93 * grey(road(LANE), VIEW)[truth].mean()
    assert (smooth[VIEW.ahead_m > 25] == grey(road(LANE), VIEW)[VIEW.ahead_m > 25]).all()


def edges_after(smooth, image):
    lower, view = below_horizon(image)
    response = np.zeros(image.shape[:2], np.uint8)
    response[-lower.shape[0] :] = canny(smooth(grey(lower, view), view), view).response
    return response


def test_smoothing_finds_the_lines_again_under_noise():
    """Sensor noise of 20 grey levels for the Gaussian, 5 % salt and pepper for the median (A10, A11)."""
    image, truth = road(LANE, verge_m=4.0), paint(verge_m=4.0)
    noisy = np.clip(image + RNG.normal(0, 20, image.shape), 0, 255).astype(np.uint8)
    clean = f1(edges_after(lambda i, v: gaussian(i, v, sigma_px=1.5), image), truth)
    assert f1(edges_after(lambda i, v: gaussian(i, v, sigma_px=1.5), noisy), truth) > 0.98 * clean
    assert f1(edges_after(lambda i, v: i, noisy), truth) < 0.9 * clean, "it is the smoothing that does it"
    salted = image.copy()
    salted[RNG.random(image.shape[:2]) < 0.025] = 255
    salted[RNG.random(image.shape[:2]) < 0.025] = 0
    clean = f1(edges_after(median, image), truth)
    assert f1(edges_after(median, salted), truth) > 0.98 * clean
    assert f1(edges_after(lambda i, v: i, salted), truth) < 0.9 * clean


def test_the_high_pass_removes_slow_changes_of_light():
    ramp = np.tile(np.linspace(40, 200, 320), (240, 1)).astype(np.uint8)
    flat = high_pass(ramp, VIEW)[:, 60:-60]
    assert np.abs(flat.astype(int) - 128).max() <= 2
    ramp[:, 160:163] += 50
    assert high_pass(ramp, VIEW)[:, 160:163].min() > 165


def test_contrast_enhancement_finds_faint_edges():
    faint = (90 + (road(LANE, verge_m=4.0).astype(float) - 90) * 0.15).clip(0, 255).astype(np.uint8)
    truth = paint(verge_m=4.0)
    plain, raised = (
        recall(edges_after(call, faint), truth) for call in (gaussian, lambda i, v: clahe(gaussian(i, v), v))
    )
    assert raised > plain + 0.05


def test_a_dark_road_is_brightened_and_a_bright_one_unchanged():
    image = road(LANE)
    night = (image * 0.2).astype(np.uint8)
    lifted = low_light(night, VIEW)
    assert 70 < np.median(grey(lifted, VIEW)[ROAD]) < 100
    assert low_light(image, VIEW) is image
    assert (
        recall(edges_after(gaussian, lifted), paint()) > recall(edges_after(gaussian, night), paint()) + 0.3
    )


def test_a_matched_histogram_is_the_reference():
    image = grey(road(LANE), VIEW)
    reference = np.bincount(RNG.normal(120, 40, 60000).clip(0, 255).astype(int), minlength=256)
    smooth = np.clip(RNG.gamma(4, 15, (240, 320)), 0, 255).astype(np.uint8)
    out = matching(np.bincount(smooth.ravel(), minlength=256), reference)[smooth]
    cumulative = [np.cumsum(c) / c.sum() for c in (np.bincount(out.ravel(), minlength=256), reference)]
    # A level cannot be split: the distance is at most the share of the fullest level of the input.
    assert (
        np.abs(cumulative[0] - cumulative[1]).max()
        < np.bincount(smooth.ravel()).max() / smooth.size + 2 / 256
    )
    own = np.bincount(image.ravel(), minlength=256)
    table = matching(own, own)
    shares = np.cumsum(own) / own.sum()
    assert np.abs(shares[table] - shares)[image].max() < 1 / 255, (
        "matched to itself it stays, but for rare levels"
    )
    assert (table[table] == table).all(), "and matching again changes nothing"
    assert (np.diff(table.astype(int)) >= 0).all()


def test_matching_removes_the_brightness_of_the_picture():
    """The steering of a net spreads with the brightness of its input; Deep Steer's claim is a third of it."""
    image = road(LANE)
    plain, matched = [], []
    for gain in (0.5, 0.7, 1.0, 1.4, 2.0):
        seen = np.clip(image * gain, 0, 255).astype(np.uint8)
        plain.append(grey(seen, VIEW)[ROAD].mean())
        matched.append(grey(match_histogram(seen, VIEW), VIEW)[ROAD].mean())
    assert np.std(matched) < np.std(plain) / 3


def test_a_cast_shadow_is_removed_and_the_markings_are_kept():
    """At least 90 % of the shadow's edges, at least 95 % of the paint (A14)."""
    image = road(LANE, verge_m=4.0)
    shaded = bars(image, from_m=6.0, to_m=9.0)
    truth = paint(verge_m=4.0)
    edge_rows = [int(np.flatnonzero(VIEW.ahead_m <= x)[0]) for x in (6.0, 9.0)]

    def steps(picture):
        """Mean |∂y| on the two edges of the bar, on asphalt between the lines."""
        slope = np.abs(
            cv2.Sobel(cv2.GaussianBlur(grey(picture, VIEW), (0, 0), 1.5), cv2.CV_32F, 0, 1, scale=1 / 8)
        )
        return np.mean(
            [slope[row - 2 : row + 3, 140:170].max(axis=0).mean() for row in edge_rows]
        ) - np.median(slope[180:230, 140:170])

    clean = without_shadows(shaded, VIEW)
    assert steps(clean) < 0.1 * steps(shaded)
    response = canny_auto(clean, VIEW).response
    assert recall(response, truth) > 0.95
    inside = VIEW.ahead_m[:, None] * np.ones(320) < 8.5
    middle = inside & (VIEW.ahead_m[:, None] * np.ones(320) > 6.5) & ~truth
    middle[:, :120] = middle[:, 200:] = False
    assert clean[middle].mean() == pytest.approx(image[middle].mean(), rel=0.15), "as bright as in the sun"


def test_without_a_shadow_the_picture_is_unchanged():
    image = road(LANE)
    assert np.abs(without_shadows(image, VIEW).astype(int) - image).mean() < 2


def test_a_picture_is_its_own_integral_where_no_edge_is_zeroed():
    values = RNG.normal(0, 1, (24, 40)).astype(np.float32)
    back = reintegrate(values, np.zeros(values.shape, bool))
    assert back == pytest.approx(values - values.mean(), abs=1e-4)


def test_an_edge_between_colours_is_no_shadow_edge():
    edges = shadow_edges(road(LANE, left=None, right=None), VIEW, step=0.08, material=0.06, marking_m=0.3)
    assert edges[ROAD].mean() < 0.01
    assert shadow_edges(bars(road(LANE)), VIEW, step=0.08, material=0.06, marking_m=0.3)[ROAD].sum() > 300
    assert SKY_LIGHT[0] > SKY_LIGHT[2], "the light of the sky is blue"


def test_wavelets_with_gains_of_one_restore_the_picture():
    image = grey(road(LANE), VIEW)
    assert np.abs(wavelet(image, VIEW, upright=1.0, level=1.0).astype(int) - image).max() <= 1


def test_wavelets_keep_upright_stripes_and_damp_level_ones():
    upright, level = np.full((64, 64), 100, np.uint8), np.full((64, 64), 100, np.uint8)
    upright[:, 31:34], level[31:34] = 160, 160
    assert wavelet(upright, VIEW).std() > 1.3 * upright.std()
    assert wavelet(level, VIEW).std() < 0.6 * level.std(), "its mean over many rows stays"


def test_row_means_are_exact_between_pixels():
    image = np.tile(np.arange(320) // 2, (240, 1)).astype(np.uint8)
    (mean,) = row_means(image, (0.3, -0.3), VIEW)
    inner = mean[150:, 40:-40]
    assert inner == pytest.approx(np.broadcast_to(np.arange(320)[40:-40] / 2, inner.shape) - 0.25, abs=0.3)
    assert (mean[~ROAD] == 0).all()
