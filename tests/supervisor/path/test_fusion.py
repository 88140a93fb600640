"""Fusion: agreeing estimates are joined, contradicting ones never averaged, and memory is short."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.inputs.validation import ValidatedEstimate
from supervisor.path.fusion import Fusion, FusionResult, information
from supervisor.supervisor import SupervisorSettings
from trepid.clothoid import Lane, Motion
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).fusion
DRIVING = Motion(speed_mps=8.0, yaw_rate_radps=0.0)
STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)
LEFT = Lane(0.0, 0.0, 0.06, 0.0)  # a road that bends left ...
RIGHT = Lane(0.0, 0.0, -0.06, 0.0)  # ... and a lane that bends right


def estimate_of(
    lane: Lane | None,
    name: str = "cv",
    *,
    t_s: float = 0.0,
    confidence: float = 0.9,
    from_memory: bool = False,
) -> ValidatedEstimate:
    return ValidatedEstimate(
        estimator=name,
        age_s=0.0,
        t_s=t_s,
        broken=False,
        confidence=confidence,
        lane=lane,
        lookahead_m=10.0,
        width_error_m=0.0,
        measures_width=True,
        from_memory=from_memory,
    )


def fuse(
    *sightings: ValidatedEstimate, motion: Motion = DRIVING, fusion: Fusion | None = None, now_s: float = 0.0
) -> FusionResult:
    return (fusion or Fusion(SETTINGS)).step(list(sightings), motion, now_s=now_s)


def lane_of(fused: FusionResult) -> Lane:
    assert fused.path is not None
    return fused.path.lane


def mirror(lane: Lane) -> Lane:
    return Lane(-lane.offset_m, -lane.heading_rad, -lane.curvature_1pm, -lane.curvature_rate_1pm2)


LANES = st.builds(
    Lane,
    offset_m=st.floats(-1, 1),
    heading_rad=st.floats(-0.2, 0.2),
    curvature_1pm=st.floats(-0.06, 0.06),
    curvature_rate_1pm2=st.floats(-0.003, 0.003),
    lookahead_m=st.just(math.inf),
)


def test_agreeing_estimates_are_averaged_by_the_inverse_of_their_variances() -> None:
    fused = fuse(
        estimate_of(Lane(0.1, 0.0, 0.0, 0.0), "cv", confidence=0.9),
        estimate_of(Lane(0.4, 0.0, 0.0, 0.0), "cnn", confidence=0.6),
    )
    cv, cnn = information(0.9 * SETTINGS.trust["cv"]), information(0.6 * SETTINGS.trust["cnn"])
    assert fused.sources == ("cv", "cnn")
    assert fused.trust == pytest.approx((cv / (cv + cnn), cnn / (cv + cnn)))
    assert lane_of(fused).offset_m == pytest.approx((cv * 0.1 + cnn * 0.4) / (cv + cnn))


@pytest.mark.parametrize("confidence", [0.2, 0.5, 0.9])
def test_a_confidence_is_the_chance_to_be_within_a_tolerance(confidence: float) -> None:
    sigma = 1 / math.sqrt(information(confidence))
    assert math.erf(1 / (sigma * math.sqrt(2))) == pytest.approx(confidence)


def test_an_estimator_of_less_trust_has_less_weight() -> None:
    one, other = estimate_of(Lane(0.1, 0.0, 0.0, 0.0)), estimate_of(Lane(0.4, 0.0, 0.0, 0.0), "cnn")
    plain = Fusion(SETTINGS).step([one, other], DRIVING, now_s=0.0)
    doubtful = Fusion(SETTINGS).step([one, other], DRIVING, now_s=0.0, trust={"cnn": 0.1})
    assert doubtful.trust[1] < 0.1 * plain.trust[1]
    assert lane_of(doubtful).offset_m == pytest.approx(0.1, abs=0.01)


def test_a_jump_of_the_only_estimate_is_delayed_and_then_accepted() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(STRAIGHT), fusion=fusion)
    aside = Lane(0.9, 0.0, 0.0, 0.0)
    for frame in range(1, 6):
        t_s = 0.04 * frame
        fused = fuse(estimate_of(aside, t_s=t_s), fusion=fusion, now_s=t_s)
        assert fused.sources == () and lane_of(fused).offset_m == 0.0
        assert fused.weighted_separation_m == pytest.approx(0.81)  # which raises fear
    fused = fuse(estimate_of(aside, t_s=0.28), fusion=fusion, now_s=0.28)
    assert fused.sources == ("cv",) and lane_of(fused) == aside


def test_a_jump_that_two_estimates_share_is_accepted_at_once() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(STRAIGHT), fusion=fusion)
    aside = Lane(0.9, 0.0, 0.0, 0.0)
    fused = fuse(estimate_of(aside, t_s=0.04), estimate_of(aside, "cnn", t_s=0.04), fusion=fusion, now_s=0.04)
    assert fused.sources == ("cv", "cnn") and lane_of(fused).offset_m == pytest.approx(0.9)


def test_a_view_that_was_left_out_is_not_joined_when_the_other_errs_towards_it() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(STRAIGHT), estimate_of(STRAIGHT, "cnn"), fusion=fusion)
    for frame, (cv_m, cnn_m, joined) in enumerate(
        [(0.7, 0.0, 1), (0.6, 0.2, 1), (0.7, 0.0, 1), (0.1, 0.0, 2)]
    ):
        t_s = 0.04 * (frame + 1)
        estimates = [
            estimate_of(Lane(e, 0.0, 0.0, 0.0), n, t_s=t_s) for n, e in (("cv", cv_m), ("cnn", cnn_m))
        ]
        assert len(fuse(*estimates, fusion=fusion, now_s=t_s).sources) == joined


@pytest.mark.parametrize(("confidence", "begins"), [(0.3, False), (0.49, False), (0.6, True)])
def test_a_single_estimate_starts_a_road_only_at_sufficient_confidence(
    confidence: float, *, begins: bool
) -> None:
    fused = fuse(estimate_of(STRAIGHT, confidence=confidence))
    assert (fused.path is not None, bool(fused.sources)) == (begins, begins)
    assert (
        len(fuse(*[estimate_of(STRAIGHT, name, confidence=confidence) for name in ("cv", "cnn")]).sources)
        == 2
    )


def test_an_estimate_that_continues_the_remembered_road_may_have_low_confidence() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(STRAIGHT), fusion=fusion)
    assert fuse(estimate_of(STRAIGHT, t_s=0.04, confidence=0.3), fusion=fusion, now_s=0.04).sources == ("cv",)
    elsewhere = Lane(1.5, 0.0, 0.0, 0.0)
    for frame in range(2, 24):
        t_s = 0.04 * frame
        seen = estimate_of(elsewhere, t_s=t_s, confidence=0.3)
        assert not fuse(seen, fusion=fusion, now_s=t_s).sources


def wobble_m(confidence: float) -> float:
    """Largest step of the path between frames while the only estimate jumps 0.2 m to and fro."""
    fusion, places = Fusion(SETTINGS), []
    for frame in range(40):
        lane = Lane(0.1 if frame % 2 else -0.1, 0.0, 0.0, 0.0)
        t_s = 0.04 * frame
        seen = estimate_of(lane, t_s=t_s, confidence=confidence if frame else 0.9)
        fused = fuse(seen, fusion=fusion, now_s=t_s)
        places.append(lane_of(fused).offset_m)
    return abs(places[-1] - places[-2])


def test_memory_steadies_an_unsure_view_and_hardly_slows_a_sure_one() -> None:
    assert wobble_m(0.98) > 0.12
    assert wobble_m(0.3) < 0.06


def test_a_frame_counts_once_for_any_number_of_decisions() -> None:
    once, often = Fusion(SETTINGS), Fusion(SETTINGS)
    for fusion, times in ((once, 1), (often, 5)):
        for frame in range(3):
            view = estimate_of(Lane(0.1 * frame, 0.0, 0.0, 0.0), t_s=0.04 * frame, confidence=0.5)
            for _ in range(times):
                fused = fuse(view, fusion=fusion, now_s=0.04 * frame)
        assert lane_of(fused).offset_m == pytest.approx(lane_of(fuse(view, fusion=once, now_s=0.08)).offset_m)


@settings(max_examples=60, deadline=None)
@given(LANES, LANES)
def test_two_contradicting_roads_are_never_averaged(one: Lane, other: Lane) -> None:
    fused = fuse(estimate_of(one, "cv"), estimate_of(other, "cnn"))
    apart_m = abs(one.y_m(8.0) - other.y_m(8.0)), abs(one.offset_m - other.offset_m)
    if apart_m[0] > SETTINGS.gate_lookahead_m or apart_m[1] > SETTINGS.gate_offset_m:
        assert lane_of(fused) == one  # without a memory the more trusted
    else:
        assert len(fused.sources) == 2


@pytest.mark.parametrize(("remembered", "taken"), [(LEFT, "cnn"), (RIGHT, "cv")])
def test_of_two_contradicting_roads_the_path_keeps_the_driven_one(remembered: Lane, taken: str) -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(remembered), fusion=fusion)
    fused = fuse(
        estimate_of(RIGHT, "cv", t_s=0.04), estimate_of(LEFT, "cnn", t_s=0.04), fusion=fusion, now_s=0.04
    )
    assert fused.sources == (taken,)
    assert lane_of(fused).curvature_1pm == pytest.approx(remembered.curvature_1pm)
    assert lane_of(fused).offset_m == pytest.approx(0.0, abs=0.01)


def roads_of(
    fusion: Fusion, frames: int, *, from_memory: bool, seen_confidence: float = 0.9
) -> list[FusionResult]:
    """The results while ``cv`` says straight on and ``cnn`` sees a bend, after both have said straight on."""
    fuse(estimate_of(STRAIGHT), estimate_of(STRAIGHT, "cnn"), fusion=fusion)
    times_s = [0.04 * frame for frame in range(1, frames + 1)]
    return [
        fuse(
            estimate_of(STRAIGHT, t_s=t_s, from_memory=from_memory),
            estimate_of(RIGHT, "cnn", t_s=t_s, confidence=seen_confidence),
            fusion=fusion,
            now_s=t_s,
        )
        for t_s in times_s
    ]


def test_a_road_that_one_estimator_remembers_does_not_keep_out_the_one_that_another_sees() -> None:
    assert roads_of(Fusion(SETTINGS), 10, from_memory=False)[-1].sources == ("cv",)
    *first, last = roads_of(Fusion(SETTINGS), 10, from_memory=True)
    assert first[0].sources == () and first[0].weighted_disagreement_mps2 > 1.0  # which raises fear
    assert last.sources == ("cnn",) and lane_of(last).curvature_1pm == pytest.approx(
        RIGHT.curvature_1pm, abs=0.01
    )


def test_a_road_that_is_remembered_surely_is_kept_against_one_that_is_seen_unsurely() -> None:
    assert roads_of(Fusion(SETTINGS), 10, from_memory=True, seen_confidence=0.3)[-1].sources == ("cv",)


def test_what_an_estimator_remembers_is_driven_where_nobody_sees_a_road() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(STRAIGHT), fusion=fusion)
    fused = fuse(estimate_of(STRAIGHT, t_s=0.04, from_memory=True), fusion=fusion, now_s=0.04)
    assert fused.sources == ("cv",)


def test_disagreement_is_in_lateral_acceleration_and_counts_less_against_a_confident_estimate() -> None:
    fused = fuse(estimate_of(LEFT, "cv", confidence=0.9), estimate_of(RIGHT, "cnn", confidence=0.3))
    assert fused.disagreement_mps2 == pytest.approx(0.12 * DRIVING.speed_mps**2)
    share = 0.3 / 0.9
    assert fused.weighted_disagreement_mps2 == pytest.approx(0.12 * DRIVING.speed_mps**2 * share)


def test_separation_is_how_far_apart_the_car_is_placed() -> None:
    aside = Lane(0.6, 0.0, 0.0, 0.0)
    assert fuse(estimate_of(STRAIGHT), estimate_of(aside, "cnn")).weighted_separation_m == pytest.approx(0.6)
    unsure = fuse(estimate_of(STRAIGHT), estimate_of(aside, "cnn", confidence=0.3))
    assert unsure.weighted_separation_m == pytest.approx(0.2)


def test_a_single_estimate_has_no_disagreement() -> None:
    fused = fuse(estimate_of(LEFT, "cv"), estimate_of(None, "cnn"))
    assert fused.disagreement_mps2 is None
    assert fused.sources == ("cv",)
    assert fused.trust == (1.0,)


def test_without_estimates_the_path_is_remembered_for_a_second_and_then_gone() -> None:
    fusion = Fusion(SETTINGS)
    fuse(estimate_of(Lane(0.2, 0.01, 0.0, 0.0)), fusion=fusion)
    coasting = fuse(fusion=fusion, now_s=0.5)
    assert coasting.path is not None
    assert coasting.path.source == "memory"
    assert coasting.sources == ()
    assert lane_of(coasting).offset_m == pytest.approx(0.2 + 0.01 * 8.0 * 0.5)
    assert fuse(fusion=fusion, now_s=SETTINGS.memory_s + 0.01).path is None


def test_without_estimates_ever_there_is_no_path() -> None:
    assert fuse().path is None


def test_estimates_of_different_frames_are_brought_to_the_newest() -> None:
    """8 m/s, heading 0.01 rad left of the lane: 0.04 s later the car is 0.0032 m further left."""
    fused = fuse(
        estimate_of(Lane(0.0, 0.01, 0.0, 0.0), "cv", t_s=0.0),
        estimate_of(Lane(0.0032, 0.01, 0.0, 0.0), "cnn", t_s=0.04),
        now_s=0.05,
    )
    assert fused.path is not None
    assert fused.path.t_s == 0.04
    assert lane_of(fused).offset_m == pytest.approx(0.0032)
    assert fused.disagreement_mps2 == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("radius_m", [15.0, -15.0, 200.0])
def test_a_car_on_the_arc_of_its_lane_stays_on_it(radius_m: float) -> None:
    lane, motion = Lane(0.0, 0.0, 1 / radius_m, 0.0), Motion(5.0, 5.0 / radius_m)
    for _ in range(25):
        lane = lane.after(motion, 0.04)
    assert lane.offset_m == pytest.approx(0.0, abs=0.01)
    assert lane.heading_rad == pytest.approx(0.0, abs=0.002)
    assert lane.curvature_1pm == pytest.approx(1 / radius_m)


@settings(max_examples=40, deadline=None)
@given(LANES, st.floats(0, 20), st.floats(-0.5, 0.5), st.floats(0, 0.1))
def test_prediction_there_and_back_returns_the_lane(lane: Lane, speed: float, yaw: float, dt: float) -> None:
    motion = Motion(speed, yaw)
    back = lane.after(motion, dt).after(motion, -dt)
    assert back.offset_m == pytest.approx(
        lane.offset_m, abs=0.15
    )  # small angles: second order in way · heading
    assert back.curvature_1pm == pytest.approx(lane.curvature_1pm, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(LANES, LANES, st.floats(-0.4, 0.4))
def test_the_mirror_image_of_the_estimates_gives_the_mirror_image_of_the_path(
    one: Lane, other: Lane, yaw: float
) -> None:
    here = fuse(estimate_of(one), estimate_of(other, "cnn", t_s=0.04), motion=Motion(8.0, yaw))
    there = fuse(
        estimate_of(mirror(one)), estimate_of(mirror(other), "cnn", t_s=0.04), motion=Motion(8.0, -yaw)
    )
    assert lane_of(there) == mirror(lane_of(here))
    assert there.sources == here.sources
    assert there.disagreement_mps2 == here.disagreement_mps2
    assert math.isfinite(lane_of(here).offset_m)


def separation_of(fusion: Fusion, t_s: float, apart_m: float | None) -> float:
    """Separation at ``t_s`` of two equally confident estimates ``apart_m`` apart; None: only one has a lane."""
    estimates = [estimate_of(STRAIGHT, t_s=t_s)]
    if apart_m is not None:
        estimates.append(estimate_of(Lane(apart_m, 0.0, 0.0, 0.0), "cnn", t_s=t_s))
    return fuse(*estimates, fusion=fusion, now_s=t_s).weighted_separation_m


def test_a_difference_of_a_few_frames_is_no_second_road_and_a_lasting_one_is() -> None:
    fusion, lasting = Fusion(SETTINGS), round(SETTINGS.lasting_s / 0.04)
    before = [separation_of(fusion, 0.04 * i, 0.05) for i in range(20)]
    during = [separation_of(fusion, 0.04 * i, 0.4) for i in range(20, 40)]
    assert max(before) == pytest.approx(0.05)
    assert during[: lasting - 1] == pytest.approx([0.05] * (lasting - 1))
    assert during[lasting + 1 :] == pytest.approx([0.4] * (20 - lasting - 1))


def test_two_roads_count_at_once_from_the_first_frame_and_again_after_a_gap() -> None:
    fusion = Fusion(SETTINGS)
    assert separation_of(fusion, 0.0, 0.05) == pytest.approx(0.05)
    assert separation_of(fusion, 1.0, 0.4) == pytest.approx(0.4)


@given(st.sets(st.integers(1, 19)))
def test_frames_of_a_single_estimator_do_not_lower_a_contradiction(missed: set[int]) -> None:
    fusion = Fusion(SETTINGS)
    for i in range(20):
        apart_m = separation_of(fusion, 0.04 * i, None if i in missed else 0.4)
        assert apart_m == pytest.approx(0.0 if i in missed else 0.4)
