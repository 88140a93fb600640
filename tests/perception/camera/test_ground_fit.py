"""Focal length and mounting from the exact motion of points of the ground."""

from dataclasses import replace

import numpy as np
import pytest

from perception.camera.ground_fit import optics, turning
from perception.camera.ground_flow import GroundFlow

F, H, AHEAD_M, DT_S = 430.0, 1.5, 1.7, 0.05
HORIZON_PX, ASIDE_PX = 6.0, -8.0  # of the true horizon above, of the true direction left of the assumed ones
RATES_RADPS = 0.15 * np.sin(np.linspace(0, 3, 40))


def pair(
    rng: np.random.Generator,
    rate_radps: float,
    *,
    pitch_rad: float = 0.0,
    bias_radps: float = 0.0,
    noise_px: float = 0.0,
) -> GroundFlow:
    """60 points of a plane ground before and after a rigid motion along an arc, through a pinhole."""
    way_m, turn_rad = 0.6, rate_radps * DT_S
    x, y = rng.uniform(4.0, 20.0, 60), rng.uniform(-4.0, 4.0, 60)
    ahead, left = x + AHEAD_M, y  # from the axle
    moved = np.array([ahead - way_m * np.cos(turn_rad / 2), left - way_m * np.sin(turn_rad / 2)])
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    ahead_after, left_after = np.array([[c, s], [-s, c]]) @ moved
    before = np.column_stack([-F * y / x, F * H / x])
    x_after = ahead_after - AHEAD_M
    after = np.column_stack([-F * left_after / x_after, F * H / x_after + F * pitch_rad])
    off = np.array([ASIDE_PX, HORIZON_PX])
    noise = rng.normal(0, noise_px, (2, 60, 2)) if noise_px else np.zeros((2, 60, 2))
    return GroundFlow(
        before - off + noise[0], after - off + noise[1], way_m, turn_rad + bias_radps * DT_S, DT_S
    )


def drive(rates: np.ndarray = RATES_RADPS, seed: int = 1, **kwargs: float) -> list[GroundFlow]:
    rng = np.random.default_rng(seed)
    return [pair(rng, float(rate), **kwargs) for rate in rates]


def test_exact_motion_gives_focal_length_height_horizon_and_direction():
    found = optics(drive(), 380.0)
    assert found.focal_height_pxm == pytest.approx(F * H, rel=0.003)
    assert found.focal_px == pytest.approx(F, rel=0.01)
    assert found.horizon_px == pytest.approx(HORIZON_PX, abs=0.3)
    assert found.aside_px == pytest.approx(ASIDE_PX, abs=0.5)


def test_corners_with_noise_on_a_fifth_of_wrong_ones_give_the_same_camera():
    rng = np.random.default_rng(5)
    pairs = drive(noise_px=0.1)
    for number, one in enumerate(pairs):
        wrong = rng.random(60) < 0.2
        after = one.after_px + wrong[:, None] * rng.uniform(-30, 30, (60, 2))
        pairs[number] = replace(one, after_px=after)
    found = optics(pairs, 380.0)
    assert found.focal_height_pxm == pytest.approx(F * H, rel=0.02)
    assert found.focal_px == pytest.approx(F, rel=0.03)


def test_the_change_of_pitch_of_each_pair_is_not_taken_for_way():
    rng = np.random.default_rng(3)
    pitching = rng.normal(0, 0.0015, len(RATES_RADPS))
    pairs = [
        pair(rng, float(rate), pitch_rad=float(p)) for rate, p in zip(RATES_RADPS, pitching, strict=True)
    ]
    assert optics(pairs, 380.0).focal_height_pxm == pytest.approx(F * H, rel=0.02)


def test_a_constant_error_of_the_yaw_rate_is_not_taken_for_another_lens():
    both_ways = np.concatenate([RATES_RADPS, -RATES_RADPS])
    found = optics(drive(both_ways, bias_radps=0.005), 380.0)
    assert found.focal_px == pytest.approx(F, rel=0.02)


def test_a_mirrored_drive_gives_the_same_lens_and_the_opposite_side():
    pairs, flip = drive(), np.array([-1.0, 1.0])
    mirrored = [
        replace(one, before_px=one.before_px * flip, after_px=one.after_px * flip, turn_rad=-one.turn_rad)
        for one in pairs
    ]
    one, other = optics(pairs, 380.0), optics(mirrored, 380.0)
    assert other.focal_px == pytest.approx(one.focal_px, rel=1e-6)
    assert other.aside_px == pytest.approx(-one.aside_px, rel=1e-6)
    assert other.horizon_px == pytest.approx(one.horizon_px, rel=1e-6)


@pytest.mark.parametrize("rates", [np.zeros(30), np.full(30, 1e-4)])
def test_a_straight_drive_measures_no_focal_length(rates):
    found = optics(drive(rates), 380.0)
    assert found.focal_px is None and np.isinf(found.focal_sigma)
    assert found.focal_height_pxm == pytest.approx(F * H, rel=0.003)


def test_an_unknown_turn_measures_no_focal_length_and_no_direction():
    known = optics(drive(), 380.0)
    pairs = [replace(one, turn_rad=None) for one in drive()]
    unknown = optics(pairs, 380.0)
    assert known.focal_px is not None and known.aside_px is not None
    assert unknown is None or (unknown.focal_px is None and unknown.aside_px is None)


@pytest.mark.parametrize(("amplitude", "noise"), [(0.0, 0.005), (0.01, 0.005), (0.02, 0.01)])
def test_the_noise_of_a_gyroscope_does_not_pass_for_turns(amplitude, noise):
    rng, rates = np.random.default_rng(2), amplitude * np.sin(np.linspace(0, 3, 75))
    noisy = [replace(one, turn_rad=one.turn_rad + rng.normal(0, noise * DT_S)) for one in drive(rates)]
    assert optics(noisy, 380.0).focal_px is None


def test_a_yaw_rate_of_the_wrong_sign_measures_nothing():
    reversed_yaw = [replace(one, turn_rad=-one.turn_rad) for one in drive()]
    assert optics(reversed_yaw, 380.0) is None


def test_ground_that_comes_no_nearer_measures_nothing():
    still = [replace(one, after_px=one.before_px.copy()) for one in drive()]
    away = [replace(one, before_px=one.after_px, after_px=one.before_px) for one in drive(np.zeros(30))]
    assert optics(still, 380.0) is None and optics(away, 380.0) is None


def test_an_enlarged_image_has_enlarged_pixels_and_the_same_deviations():
    found = optics(drive(), 380.0)
    larger = found.enlarge(2.0)
    assert larger.focal_px == 2 * found.focal_px and larger.focal_height_pxm == 2 * found.focal_height_pxm
    assert larger.horizon_px == 2 * found.horizon_px and larger.focal_sigma == found.focal_sigma


@pytest.mark.parametrize(("turn_rad", "known"), [(None, False), (0.0, False), (0.002, True), (-0.002, True)])
def test_a_turn_counts_from_a_yaw_rate_on(turn_rad, known):
    assert turning(turn_rad, DT_S) is known


@pytest.mark.parametrize("seed", range(60))
def test_arbitrary_corners_give_finite_values_or_none(seed):
    rng, pairs = np.random.default_rng(seed), []
    for _ in range(rng.integers(1, 8)):
        before = np.column_stack([rng.uniform(-200, 200, 15), rng.uniform(1, 200, 15)])
        if seed % 3 == 0:
            before[:] = before[0]
        moved = (
            rng.uniform(-300, 300, (15, 2)),
            before + rng.normal(0, 30, (15, 2)),
            before * rng.uniform(0.5, 2),
        )
        turn_rad = None if rng.random() < 0.2 else float(rng.normal(0, 0.3))
        pairs.append(GroundFlow(before, moved[rng.integers(3)], float(rng.uniform(0.1, 3)), turn_rad, DT_S))
    found = optics(pairs, float(rng.uniform(50, 800)))
    if found is not None:
        values = [found.focal_height_pxm, found.focal_height_sigma, found.horizon_px, found.aside_px or 0.0]
        assert np.isfinite(values).all() and found.focal_height_pxm > 0
        assert (found.focal_px is None) == (found.aside_px is None)
        assert found.focal_px is None or (np.isfinite(found.focal_sigma) and found.focal_px > 0)
