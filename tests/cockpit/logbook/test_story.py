"""Every moment of every recording is explained; at a calm one the answer states what would raise fear."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_rig import record_drive
from supervisor_rig import STATE, Drive
from typer.testing import CliRunner

from cockpit.logbook.explain_drive import moment_figure
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import next_level, raising, story
from cockpit.logbook.story_text import story_text
from cockpit.rulebook.cli import app
from sim_harness.scenarios.scenario import load_scenario
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest, worst
from supervisor.rules.rule_file import LEVELS
from trepid.config import CONFIG_DIR
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording, attachments
from trepid.topics import DECISION, VEHICLE_STATE
from trepid.wire import to_cdr

pytestmark = pytest.mark.long

DRIVES = {
    "lying_cv": {"sight": "truth", "duration_s": "9"},
    "lost_cnn": {"sight": "truth", "duration_s": "6"},
    "cut_in": {"sight": "truth", "duration_s": "8"},
    "straight": {"duration_s": "1"},
}
MOMENTS = 100
RULES = FearRules.load(CONFIG_DIR / "fear.yaml")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Lock-step recordings, a part of one from its middle, and one that was cut short."""
    folder = tmp_path_factory.mktemp("drives")
    paths = {}
    for name, changes in DRIVES.items():
        scenario = load_scenario(name, changes)
        paths[name] = folder / f"{name}.mcap"
        record_drive(paths[name], scenario, seed=5)
    whole = paths["lying_cv"]
    paths["part"] = folder / "part.mcap"
    held = read_recording(whole)
    with Recording(paths["part"], held.files, {"what": "part"}) as file:
        for log_ns, key, data in in_order(whole):
            if log_ns > 1003e9:
                file.add(key, data, at_s=log_ns / 1e9)
    paths["cut"] = folder / "cut.mcap"
    data = whole.read_bytes()
    paths["cut"].write_bytes(data[: int(0.7 * len(data))])
    return paths


@pytest.fixture(scope="module")
def calm(drives: dict[str, Path]) -> Recall:
    return recall(drives["straight"])


def test_a_hundred_random_moments_of_recordings_are_answered(drives: dict[str, Path]) -> None:
    rng = np.random.default_rng(7)
    told = {name: recall(path) for name, path in drives.items()}
    kinds = set()
    for name in rng.choice(sorted(told), MOMENTS):
        drive = told[name]
        span_s = drive.recorded.last_s - drive.recorded.first_s
        at_s = drive.recorded.first_s - drive.zero_s + float(rng.uniform(0.0, span_s))
        found = story(drive, at_s)
        answer = json.loads(json.dumps(found, allow_nan=False))
        assert answer["level"] in LEVELS and answer["mode"] and answer["repeats"]
        assert 0.0 <= answer["fear"] <= 1.0 and answer["rules"]
        assert len(story_text(found).splitlines()) > 3
        if found["slowed_by"] == "supervisor" and found["slow_down"]["speed_before_mps"] is not None:
            held_mps = found["slow_down"]["speed_before_mps"]
            text = story_text(found | {"slow_down": found["slow_down"] | {"speed_lowest_mps": held_mps}})
            assert f"; the vehicle held {held_mps:.1f} m/s." in text and "slowed from" not in text
        kinds.add(answer["slowed_by"])
    assert kinds >= {None, "supervisor"}


def test_a_calm_moment_has_fear_rules_and_the_inputs_that_would_raise_it(calm: Recall) -> None:
    answer = story(calm, 0.8)
    assert answer["slowed_by"] is None and answer["decision_age_s"] == pytest.approx(0.0, abs=0.05)
    assert answer["level"] == "very_low" and answer["next_level"] == "low"
    index = calm.index_at(0.8)
    decision = calm.decisions[index]
    assert answer["speed_mps"] == calm.speed_mps[index]
    recorded = dict(zip(decision.inputs, decision.input_values, strict=True))
    assert answer["raised_by"]
    for one in answer["raised_by"]:
        assert one["value"] == recorded[one["name"]]
        risen = calm.rules.evaluate({**recorded, one["name"]: one["from"]})
        assert risen.level != "very_low" and risen.cause == one["cause"]
    text = story_text(answer)
    assert text.startswith("The vehicle did not slow down near 0.8 s.\nAt 0.")
    assert "Fear would rise to low or above by one of these inputs alone" in text
    assert answer["raised_by"][0]["name"] in text


def test_the_value_that_raises_fear_is_the_first_one_that_does() -> None:
    values = calmest(RULES)
    found = raising(RULES, values)
    assert found
    for name, value, _ in found:
        low, high = RULES.inputs[name].range
        a_little_calmer = value + 3e-4 * (RULES.inputs[name].calmest - RULES.inputs[name].worst)
        assert RULES.evaluate({**values, name: value}).level != LEVELS[0]
        assert RULES.evaluate({**values, name: min(max(a_little_calmer, low), high)}).level == LEVELS[0]


def test_nothing_raises_the_highest_fear_and_a_missing_input_is_the_highest() -> None:
    lost = {**calmest(RULES), "lane_confidence": None}
    for values in (worst(RULES), lost):
        assert raising(RULES, values) == []
        assert next_level(RULES, RULES.evaluate(values).fear) is None


def test_a_moment_at_which_the_car_stood_says_what_it_waited_for(drives: dict[str, Path]) -> None:
    assert "The car said: starting: drives after " in story_text(story(recall(drives["straight"]), 0.5))


def test_the_nearest_slow_downs_are_named_at_a_calm_moment(drives: dict[str, Path]) -> None:
    answer = story(recall(drives["lying_cv"]), -3.0)
    if answer["slowed_by"] is None:
        assert all(math.isfinite(other_s) for other_s in answer["others_s"])
        assert story_text(answer).startswith("The vehicle did not slow down near -3.0 s")


def test_a_moment_before_the_first_decision_and_one_after_the_last_are_answered(tmp_path: Path) -> None:
    """The processes of a drive publish before its supervisor decides, and after it was killed."""
    drive = Drive.under_way()
    path = tmp_path / "drive.mcap"
    first_s = drive.now_s - 2.0
    with Recording(path, attachments(CONFIG_DIR / "fear.yaml")) as file:
        for at_s in np.arange(first_s, drive.now_s, 0.1):
            file.add(VEHICLE_STATE.key, to_cdr(replace(STATE, t_s=at_s)), at_s=at_s)
        for _ in range(20):
            decision = drive.frame()
            file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)
        end_s = drive.now_s + 3.0
        file.add(VEHICLE_STATE.key, to_cdr(replace(STATE, t_s=end_s)), at_s=end_s)
    told = recall(path)
    before = story(told, 0.5)
    assert before["decision_age_s"] < -1.0
    assert "No decision had been made yet; the first one followed 1." in story_text(before)
    after = story(told, told.recorded.last_s - told.zero_s)
    assert after["decision_age_s"] == pytest.approx(3.0, abs=0.1)
    assert "The newest decision was 3.0" in story_text(after)


def test_the_verb_answers_a_calm_moment_and_draws_it(drives: dict[str, Path], tmp_path: Path) -> None:
    picture = tmp_path / "calm.png"
    arguments = ["explain", str(drives["straight"]), "--at", "0.8", "--picture", str(picture), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["next_level"] == "low"
    assert picture.stat().st_size > 10_000


def test_the_picture_of_a_calm_moment_names_the_allowed_speed(calm: Recall) -> None:
    _, panel = moment_figure(calm, story(calm, 0.8)).axes
    assert panel.texts[1].get_text() == f"allowed {story(calm, 0.8)['speed_cap_mps']:.1f} m/s"


def test_the_answer_and_the_picture_name_the_measurement_in_doubt(tmp_path: Path) -> None:
    fault = "[{kind: wrong_measurement, quantity: yaw_rate, form: absent, from_s: 0}]"
    scenario = load_scenario("straight", {"duration_s": "3", "faults": fault})
    drive = recall(record_drive(tmp_path / "yaw.mcap", scenario))
    found = story(drive, 2.9)
    assert "cause doubted_state (yaw rate);" in story_text(found)
    _, panel = moment_figure(drive, found).axes
    assert "cause doubted_state (yaw rate)" in panel.texts[0].get_text()


def test_the_answer_says_how_far_the_camera_sees_and_what_ends_its_sight(tmp_path: Path) -> None:
    scenario = load_scenario("straight", {"duration_s": "1", "disturbances": "[{kind: fog, grade: 4}]"})
    drive = recall(record_drive(tmp_path / "fog.mcap", scenario))
    found = story(drive, 0.9)
    assert found["sight"]["sight_cause"] == "fog" and 35 < found["sight"]["sight_m"] < 60
    assert f"The camera sees {found['sight']['sight_m']:.0f} m: fog, rain or snow." in story_text(found)


def test_the_answer_says_that_a_crest_is_ahead_and_that_the_car_slows_for_it(tmp_path: Path) -> None:
    profile = [(2, 0.0), (30, 0.08), (32, 0.08), (87, -0.08), (132, 0.0)]
    elevation = str([{"at_m": at_m, "grade": grade} for at_m, grade in profile])
    scenario = load_scenario("sharp_crest", {"elevation": elevation, "duration_s": "5"})
    drive = recall(record_drive(tmp_path / "crest.mcap", scenario))
    text = story_text(story(drive, 4.9))
    assert re.search(r"The car said: at most [\d.]+ m/s: sight of \d+ m \(crest ahead\)\.", text)
    assert re.search(r"The camera sees \d+ m: crest ahead\.", text)


def test_the_answer_says_that_the_driver_was_warned_of_a_line(calm: Recall) -> None:
    found = story(calm, 0.8)
    assert (found["line_warning"], "warned" in story_text(found)) == ("", False)
    text = story_text(found | {"line_warning": "left", "line_crossing_s": 0.61})
    assert "The driver was warned: a wheel is about to cross the left edge of the lane, in 0.6 s." in text


def test_a_confidence_is_named_by_the_estimator_that_states_it_and_not_by_the_one_whose_rules_rate_it(
    tmp_path: Path,
) -> None:
    seen = {}
    for names in ("[arcs, cnn]", "[cv, cnn]"):
        changes = {"sight": "truth", "duration_s": "1", "estimators": names}
        drive = recall(record_drive(tmp_path / f"{len(seen)}.mcap", load_scenario("straight", changes)))
        found = story(drive, 0.9)
        (item,) = (one for one in found["raised_by"] if one["name"] == "cv_confidence")
        only = story_text(found | {"raised_by": [item]})
        seen[names] = item["of"], "arcs_confidence (as cv_confidence) " in only, "  cv_confidence " in only
    assert seen == {"[arcs, cnn]": (["arcs"], True, False), "[cv, cnn]": (["cv"], False, True)}
