"""The sight distance of synthetic images of known air, light and lane."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sight_rig import CAMERA, SETTINGS, arc, lit, misty, sight_in, with_trees

from perception.sight.air import WATER_INDEX, reflectance_of_water
from perception.sight.judge import ImageJudge
from perception.sight.observer import SightObserver
from trepid.causes import Cause
from trepid.messages import Frame
from trepid.scale import scaled_settings


@pytest.mark.parametrize("range_m", [25.0, 50.0, 100.0, 150.0, 200.0])
def test_air_of_known_extinction_gives_its_range_and_the_cause_fog(range_m: float) -> None:
    for seed in range(3):
        sight = sight_in(misty(range_m, seed=seed))
        assert sight is not None and sight.cause == Cause.FOG
        assert sight.distance_m == pytest.approx(range_m + CAMERA.x_m, rel=0.15)
        assert 0.02 < sight.sigma_m / sight.distance_m < 0.4


@given(st.floats(20, 250), st.floats(1.3, 3.0), st.integers(0, 99))
def test_thicker_air_never_gives_a_longer_sight(range_m: float, factor: float, seed: int) -> None:
    thin, thick = sight_in(misty(range_m * factor, seed=seed)), sight_in(misty(range_m, seed=seed))
    assert thin is not None and thick is not None
    assert thick.distance_m <= thin.distance_m


def test_clear_air_before_trees_has_full_reach_and_no_cause() -> None:
    for seed in range(5):
        sight = sight_in(with_trees(misty(5000.0, seed=seed), seed=seed))
        assert sight is not None
        assert sight.distance_m == pytest.approx(SETTINGS.reach_m) and sight.cause == ""


@pytest.mark.parametrize("range_m", [25.0, 50.0, 100.0, 200.0])
def test_in_fog_wet_ground_that_mirrors_the_sky_takes_hardly_any_sight(range_m: float) -> None:
    for wet in (0.1, 0.2, 0.3):
        sight = sight_in(misty(range_m, wet=wet))
        assert sight is not None and sight.cause == Cause.FOG
        assert sight.distance_m == pytest.approx(range_m + CAMERA.x_m, rel=0.25)


def test_water_reflects_as_fresnel_says() -> None:
    upright, grazing, brewster = reflectance_of_water(np.array([np.pi / 2, 0.0, np.arctan(1 / WATER_INDEX)]))
    assert upright == pytest.approx(((WATER_INDEX - 1) / (WATER_INDEX + 1)) ** 2)
    assert grazing == pytest.approx(1.0)
    # At Brewster's angle only the light across the plane of incidence is reflected.
    squared = WATER_INDEX**2
    assert brewster == pytest.approx(((squared - 1) / (squared + 1)) ** 2 / 2)


@pytest.mark.parametrize("range_m", [25.0, 80.0, 2000.0])
def test_the_mirror_image_has_the_same_sight(range_m: float) -> None:
    image = with_trees(misty(range_m)) if range_m > 1000 else misty(range_m)
    plain, mirrored = sight_in(image), sight_in(np.ascontiguousarray(image[:, ::-1]))
    assert plain is not None and mirrored is not None
    assert plain.cause == mirrored.cause
    # The optical centre lies half a pixel beside the middle of the image.
    assert mirrored.distance_m == pytest.approx(plain.distance_m, rel=0.03)


def test_colour_changes_nothing() -> None:
    image = misty(60.0)
    assert sight_in(np.repeat(image[:, :, None], 3, axis=2)) == sight_in(image)


def test_an_even_image_says_nothing() -> None:
    for grey in (40, 128, 200):
        assert sight_in(np.full((240, 320), grey, np.uint8)) is None


def test_a_black_image_is_dark_right_before_the_car() -> None:
    sight = sight_in(np.zeros((240, 320), np.uint8))
    assert sight is not None and sight.cause == Cause.DARK
    assert sight.distance_m == pytest.approx(SETTINGS.strip.near_m + CAMERA.x_m)


def test_a_white_image_says_nothing() -> None:
    noise = np.random.default_rng(0).integers(250, 256, (240, 320)).astype(np.uint8)
    assert sight_in(noise) is None


@pytest.mark.parametrize("noise_grey", [3.0, 6.0])
def test_by_lamps_sight_ends_where_the_target_of_rose_is_lost(noise_grey: float) -> None:
    reach_m, dark = 20.0, SETTINGS.dark
    sight = sight_in(lit(reach_m, noise_grey=noise_grey))
    x_m = np.arange(6.0, 300.0, 0.05)
    away_m = x_m - CAMERA.x_m
    pixels = CAMERA.fx_px * CAMERA.fy_px * (dark.target_side_m / away_m) ** 2
    contrast = 110 * np.exp(-0.5 * x_m / reach_m) * (math.sqrt(dark.target_ratio) - 1)
    clarity = contrast * np.minimum(np.sqrt(pixels), pixels) / noise_grey
    lost_m = x_m[np.argmax(clarity < dark.noise_multiple)]
    assert sight is not None and sight.cause == Cause.DARK
    assert sight.distance_m == pytest.approx(lost_m, rel=0.12)


def test_more_noise_by_night_never_lengthens_the_sight() -> None:
    sights = [sight_in(lit(25.0, noise_grey=noise)) for noise in (2.0, 4.0, 8.0, 16.0)]
    distances = [sight.distance_m for sight in sights if sight is not None]
    assert len(distances) == 4 and distances == sorted(distances, reverse=True)


@pytest.mark.parametrize("radius_m", [-18.0, -12.0, 12.0, 18.0])
def test_a_tight_bend_is_seen_up_to_the_side_of_the_image(radius_m: float) -> None:
    image = with_trees(misty(5000.0))
    sight = sight_in(image, lane=arc(1 / radius_m))
    # From the lens, x_m ahead of the axle, the arc is seen under the angle of the side of the image.
    way_m = np.arange(5.0, 300.0, 0.1)
    turned = way_m / radius_m
    x_m, y_m = radius_m * np.sin(turned), radius_m * (1 - np.cos(turned))
    side = np.abs(y_m) / np.maximum(x_m - CAMERA.x_m, 1e-6) * math.cos(CAMERA.pitch_down_rad)
    expected_m = way_m[np.argmax(side > CAMERA.cx_px / CAMERA.fx_px)]
    assert sight is not None and sight.cause == ""
    assert sight.distance_m == pytest.approx(expected_m, abs=3.0)
    doubtful = sight_in(image, lane=arc(1 / radius_m, confidence=0.2))
    assert doubtful is not None and doubtful.distance_m == pytest.approx(SETTINGS.reach_m)


@pytest.mark.parametrize(("wrong", "counts"), [(1, False), (8, False), (12, True)])
def test_a_lane_that_bends_out_of_the_image_for_some_frames_takes_no_sight(wrong: int, counts: bool) -> None:
    observer, image = SightObserver(SETTINGS, CAMERA), with_trees(misty(5000.0))
    for number in range(20 + wrong):
        lane = arc(0.0 if number < 20 else 1 / 12.0)
        sight = observer.step(Frame(t_s=0.04 * number, image=image), lane)
    assert sight is not None and (sight.distance_m < 0.5 * SETTINGS.reach_m) == counts


@pytest.mark.parametrize("radius_m", [-60.0, 60.0])
def test_a_bend_that_may_end_before_it_leaves_the_image_takes_no_sight(radius_m: float) -> None:
    sight = sight_in(with_trees(misty(5000.0)), lane=arc(1 / radius_m))
    assert sight is not None and sight.distance_m == pytest.approx(SETTINGS.reach_m)


@given(
    st.sampled_from([math.nan, math.inf, -math.inf, None, 0.0, 1e6, -1e6]),
    st.sampled_from(
        ["lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2", "confidence"]
    ),
)
def test_no_lane_however_broken_takes_the_sight_or_makes_it_longer_than_the_air(value, field: str) -> None:
    if field == "confidence" and value is None:
        return
    sight = sight_in(misty(50.0), lane=replace(arc(0.0), **{field: value}))
    assert sight is not None and math.isfinite(sight.distance_m) and math.isfinite(sight.sigma_m)
    assert 0.0 < sight.distance_m < 70.0


def test_images_of_another_format_or_too_small_say_nothing() -> None:
    for shape in ((240, 200), (20, 320), (31, 31)):
        assert sight_in(np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)) is None
    assert sight_in(np.zeros((240, 320), np.float32)) is None


def test_a_camera_that_sees_no_ground_says_nothing() -> None:
    assert sight_in(misty(50.0), camera=CAMERA.model_copy(update={"pitch_down_rad": -1.0})) is None


def test_fog_counts_at_once_and_its_end_slowly() -> None:
    observer, clear, fog = SightObserver(SETTINGS, CAMERA), with_trees(misty(5000.0)), misty(40.0)
    found = []
    for number in range(60):
        image = fog if 10 <= number < 20 else clear
        sight = observer.step(Frame(t_s=0.04 * number, image=image), None)
        assert sight is not None
        found.append(sight.distance_m)
    assert found[9] == pytest.approx(SETTINGS.reach_m) and found[10] < 50.0
    growth = np.diff(np.log(found[19:]))
    assert growth.max() <= SETTINGS.growth_1ps * 0.04 + 1e-9 and growth.min() >= 0.0


def test_what_ended_the_sight_stays_its_cause_until_the_sight_has_grown() -> None:
    observer, clear, fog = SightObserver(SETTINGS, CAMERA), with_trees(misty(5000.0)), misty(40.0)
    sights = [
        observer.step(Frame(t_s=0.04 * number, image=fog if number < 10 else clear), None)
        for number in range(200)
    ]
    assert all(sight is not None for sight in sights)
    causes = [(sight.cause, sight.distance_m) for sight in sights if sight is not None]
    assert all(cause == Cause.FOG for cause, distance_m in causes if distance_m < SETTINGS.reach_m / 2)
    assert causes[-1] == ("", pytest.approx(SETTINGS.reach_m))


def test_fog_far_away_does_not_take_over_a_sight_that_darkness_made_short() -> None:
    observer, black, fog = SightObserver(SETTINGS, CAMERA), np.zeros_like(misty(150.0)), misty(150.0)
    sights = [
        observer.step(Frame(t_s=0.04 * number, image=black if number < 10 else fog), None)
        for number in range(250)
    ]
    causes = [(sight.cause, sight.distance_m) for sight in sights if sight is not None]
    assert all(cause == Cause.DARK for cause, distance_m in causes if distance_m < 75.0)
    assert causes[-1][0] == Cause.FOG


def test_after_a_silence_the_next_sight_starts_anew() -> None:
    observer = SightObserver(SETTINGS, CAMERA)
    observer.step(Frame(t_s=0.0, image=misty(40.0)), None)
    sight = observer.step(Frame(t_s=2.0, image=with_trees(misty(5000.0))), None)
    assert sight is not None and sight.distance_m == pytest.approx(SETTINGS.reach_m)


@pytest.mark.parametrize("scale", [0.1, 0.5])
def test_a_small_car_sees_as_far_in_its_own_world(scale: float) -> None:
    image = misty(60.0)
    judged = ImageJudge(SETTINGS, scaled_settings(CAMERA, scale), scale).step(
        Frame(t_s=0.0, image=image), None, None, now_s=0.0
    )
    large = sight_in(image)
    assert large is not None
    assert judged.sight_m == pytest.approx(scale * large.distance_m)
    assert judged.sight_sigma_m == pytest.approx(scale * large.sigma_m)
    assert judged.sight_cause == Cause.FOG


def test_the_judge_leaves_the_sight_out_where_the_image_says_nothing() -> None:
    image = np.full((240, 320), 128, np.uint8)
    judged = ImageJudge(SETTINGS, CAMERA, 1.0).step(Frame(t_s=0.0, image=image), None, None, now_s=0.0)
    assert (judged.sight_m, judged.sight_sigma_m, judged.sight_cause) == (None, None, "")
