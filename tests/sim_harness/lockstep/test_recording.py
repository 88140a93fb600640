"""A lock-step run leaves the recording that a live drive leaves, and that answers why the car slowed down."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cockpit.logbook.explain_drive import moment_figure
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import story
from cockpit.logbook.story_text import story_text
from cockpit.rulebook.cli import app
from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import CONFIG_DIR, InputError
from trepid.recording.reader import read_recording
from trepid.topics import DECISION

LYING = load_scenario("lying_cv", {"sight": "truth", "duration_s": "12"})
"""From 5 s on the cv reports the car 0.7 m too far left."""
SEEN = load_scenario("straight", {"duration_s": "1"})
CORNER = load_scenario("sharp_corner_r12", {"sight": "truth"})


@pytest.fixture(scope="module")
def lying(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lying") / "drive.mcap"
    with recording(path, LYING) as witness:
        run(LYING, seed=3, witness=witness)
    return path


@pytest.fixture(scope="module")
def rendered_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a second with rendered pictures."""
    path = tmp_path_factory.mktemp("seen") / "drive.mcap"
    with recording(path, SEEN) as witness:
        result = run(SEEN, witness=witness)
    assert result.trace.sha256 == run(SEEN).trace.sha256, "a recorded drive is the one without a recording"
    return path


@pytest.fixture(scope="module")
def drive(lying: Path) -> Recall:
    return recall(lying)


def explain(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["explain", *arguments])
    if isinstance(result.exception, InputError):
        raise result.exception
    return result.exit_code, result.stdout


def test_a_recorded_decision_gives_its_fear_again_with_the_rules_that_were_recorded(drive: Recall) -> None:
    for decision in drive.decisions:
        evaluated = drive.rules.evaluate(dict(zip(decision.inputs, decision.input_values, strict=True)))
        assert (evaluated.fear, evaluated.level, evaluated.texts, evaluated.strengths) == (
            decision.fear,
            decision.level,
            decision.rules,
            decision.rule_strengths,
        )


def test_times_count_from_the_start_of_the_run(drive: Recall) -> None:
    assert drive.recorded.began_s is not None
    assert drive.t_s[0] < -3.0, "the run-up is recorded too"
    assert drive.t_s[-1] == pytest.approx(12.0, abs=0.05)


def test_why_did_it_slow_down_when_an_estimator_lied(drive: Recall) -> None:
    answer = story(drive, 5.5)
    assert answer["slowed_by"] == "supervisor"
    assert answer["slow_down"]["from_s"] == pytest.approx(5.0, abs=0.1)
    assert (answer["cause"], answer["limited_by"], answer["mode"]) == ("disagreement", "fear", "CAUTION")
    assert answer["rules"][0]["text"].endswith("because disagreement")
    assert answer["repeats"]
    reported_inputs = {item["name"]: item for item in answer["inputs"]}
    assert reported_inputs["separation"]["value"] > 0.4
    assert reported_inputs["separation"]["unit"] == "m"
    assert sum(reported_inputs["separation"]["sets"].values()) == pytest.approx(1.0)
    estimates = {item["estimator"]: item for item in answer["estimates"]}
    assert estimates["cv"]["lateral_offset_m"] - estimates["cnn"]["lateral_offset_m"] == pytest.approx(
        0.7, abs=0.01
    )
    assert sum(item["trust"] for item in estimates.values()) == pytest.approx(1.0)
    modes = [(moment["mode"], moment["cause"]) for moment in answer["timeline"]]
    assert modes.index(("KEEP", "none")) < modes.index(("CAUTION", "disagreement"))


def test_the_answer_names_cause_rule_value_and_estimators_in_words(drive: Recall) -> None:
    text = story_text(story(drive, 5.5))
    assert "the speed cap began to fall: from 8.0 to" in text
    assert "cause disagreement (perception); mode CAUTION" in text
    assert "if separation is medium then fear is medium because disagreement" in text
    assert "separation = 0." in text and "cnn: " in text and "cv: +0.7" in text


def test_a_later_moment_of_a_long_slow_down_is_explained_by_the_values_of_that_moment(drive: Recall) -> None:
    assert story(drive, 10.0)["moment_s"] == pytest.approx(10.0, abs=0.6)


def test_the_controller_is_named_where_the_supervisor_did_not_ask(tmp_path: Path) -> None:
    path = tmp_path / "corner.mcap"
    with recording(path, CORNER) as witness:
        trace = run(CORNER, witness=witness).trace
    slowest_s = float(trace["t_s"][trace["t_s"] > 2.0][trace["speed_mps"][trace["t_s"] > 2.0].argmin()])
    answer = story(recall(path), slowest_s)
    assert answer["slowed_by"] == "controller"
    assert 1 / answer["sharpest_curvature_1pm"] == pytest.approx(12.0, rel=0.2)
    assert "a bend of 1" in story_text(answer)


def test_the_verb_prints_the_explanation_as_text_and_as_json(lying: Path) -> None:
    code, text = explain(str(lying), "--at", "5.5")
    assert code == 0
    assert text.startswith("At 5.0")
    code, out = explain(str(lying), "--at", "5.5", "--json")
    assert code == 0
    assert json.loads(out)["cause"] == "disagreement"


def test_without_a_moment_every_slow_down_is_listed(lying: Path) -> None:
    code, text = explain(str(lying))
    assert code == 0
    assert "8.0 -> " in text and "slow-downs by the supervisor" in text
    _, lines = explain(str(lying), "--json")
    assert json.loads(lines.splitlines()[0])["cause"] == "disagreement"


def test_a_moment_without_a_slow_down_is_answered(tmp_path: Path) -> None:
    calm = load_scenario("lying_cv", {"sight": "truth", "duration_s": "3"})
    path = tmp_path / "calm.mcap"
    with recording(path, calm) as witness:
        run(calm, witness=witness)
    code, text = explain(str(path), "--at", "2")
    assert code == 0
    assert text.startswith("The vehicle did not slow down near 2.0 s")
    assert "Fear would rise to" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at", "99"], r"--at 99: the recording runs from -4\.0 to 12\.0 s"),
        (["--at", "5.5", "--picture", "p.png"], r"no picture was recorded near 5\."),
        (["--picture", "p.png"], "of which moment"),
        (["speed=3"], "a recording has its own values"),
        (["--at", "5.5", "--rules", "nowhere.yaml"], r"nowhere\.yaml: cannot be read"),
    ],
)
def test_a_question_without_an_answer_is_refused_in_one_line(
    lying: Path, arguments: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message) as error:
        explain(str(lying), *arguments)
    assert "\n" not in str(error.value)


def test_a_recording_without_decisions_is_named(lying: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(lying.read_bytes()[:20_000])  # little more than the rules
    with pytest.raises(
        InputError, match="the recording contains no decision of a supervisor; the file is cut short"
    ):
        explain(str(cut), "--at", "5")


def test_a_recording_that_was_cut_short_is_explained_as_far_as_it_goes(lying: Path, tmp_path: Path) -> None:
    data = lying.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.7 * len(data))])
    code, text = explain(str(cut), "--at", "5.5")
    assert code == 0
    assert text.startswith("(the recording is cut short: it ends at")
    assert "cause disagreement" in text


def test_other_rules_are_distinguished_from_those_of_the_drive(lying: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    text = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    other.write_text(
        text.replace(
            "if separation is very_high then fear is high",
            "if separation is very_high then fear is very_high",
        )
    )
    answer: dict[str, Any] = story(recall(lying, other), 5.5)
    assert not answer["repeats"]
    assert "the drive used other rules" in story_text(answer)


def test_every_camera_image_is_recorded_as_jpeg(rendered_recording: Path) -> None:
    read = read_recording(rendered_recording, "camera/*", DECISION.key, "perception/*")
    images = [frame.t_s for _, frame in read.messages["camera/image/compressed"]]
    estimated = [one.t_s for _, one in read.messages["perception/cv/estimate"]]
    assert images[: len(estimated)] == estimated and len(images) <= len(estimated) + 1
    drive = recall(rendered_recording)
    frame = drive.frame_at(len(drive.decisions) - 1)
    assert frame is not None
    assert set(drive.estimates_of(frame)) == {"cv", "cnn"}


def test_the_moment_is_drawn_from_the_recorded_picture(rendered_recording: Path) -> None:
    drive = recall(rendered_recording)
    told_of = {
        **dict(moment_s=0.8, mode="CAUTION", fear=0.5, level="medium", cause="dark", part=""),
        **dict(rules=[], slow_down=dict(cap_before_mps=8.0, cap_lowest_mps=4.0)),
    }
    camera, panel = moment_figure(drive, told_of).axes
    image = camera.get_images()[0].get_array()
    assert image.shape == (240, 320, 3)
    shown = [text.get_text() for text in camera.get_legend().get_texts()]
    assert [text.split(":")[0] for text in shown] == ["cnn", "cv"]
    boundaries = [np.asarray(line.get_xydata()) for line in camera.get_lines() if len(line.get_xydata())]
    assert boundaries and all(0 <= row <= 240 for boundary in boundaries for row in boundary[:, 1])
    assert panel.texts[0].get_text() == "0.80 s   CAUTION   fear 0.50, cause dark"
