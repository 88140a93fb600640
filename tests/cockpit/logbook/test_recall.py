"""A recording identifies the rules of each decision, also when they were changed while driving."""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from supervisor_rig import ESTIMATE, STATE, Drive

from cockpit.logbook.explain_drive import moment_figure
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import overview, story
from cockpit.logbook.story_text import story_text
from sim_harness.compare.drives import compare_drives
from supervisor.rules.inference import FearRules
from supervisor.rules.reload import RuleChange
from trepid.car.camera import Camera
from trepid.cli import main
from trepid.config import BAD_INPUT, CONFIG_DIR, InputError, load
from trepid.messages import CompressedFrame, Decision, Diagnostic, Health
from trepid.recording.images import recorded_car
from trepid.recording.reader import RecordingContent
from trepid.recording.writer import Recording, attachments
from trepid.topics import CAMERA_COMPRESSED, DECISION, DIAGNOSTICS, VEHICLE_STATE
from trepid.wire import to_cdr

SHIPPED = CONFIG_DIR / "fear.yaml"
OTHER = SHIPPED.read_text(encoding="utf-8").replace("low:       {at: 0.25,", "low:       {at: 0.3,")
EDGES = replace(ESTIMATE, marked=False)


def record_a_change(path: Path) -> None:
    changed = path.with_name("other.yaml")
    changed.write_text(OTHER, encoding="utf-8")
    drive = Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:

        def drive_on(frames: int) -> None:
            for _ in range(frames):
                decision = drive.frame(cv=EDGES)
                file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)

        drive_on(5)
        rules = FearRules.load(changed)
        drive.supervisor.adopt(rules)
        diagnostic = Diagnostic(
            t_s=drive.now_s,
            process="supervisor",
            health=Health.OK,
            message="",
            values=RuleChange(rules, "", OTHER).values(from_s=drive.now_s),
        )
        file.add(DIAGNOSTICS.key, to_cdr(diagnostic), at_s=drive.now_s)
        drive_on(5)


def test_every_decision_is_explained_by_its_own_rules(tmp_path: Path) -> None:
    record_a_change(tmp_path / "drive.mcap")
    drive = recall(tmp_path / "drive.mcap")
    before, after = drive.decisions[4].fear, drive.decisions[9].fear
    assert 0 < before < after
    assert all(drive.repeats(i) for i in range(10))
    assert drive.rules_from == "fear.yaml, as recorded, changed 1 times during the drive"


@pytest.mark.parametrize("name", ["mine.yaml", "mine.yml", "MINE.YAML", "mine"])
def test_the_recorded_rules_explain_a_drive_whatever_the_name_of_their_file(
    tmp_path: Path, name: str
) -> None:
    rules, path, drive = tmp_path / name, tmp_path / "drive.mcap", Drive.under_way()
    rules.write_text(OTHER, encoding="utf-8")
    drive.supervisor.adopt(FearRules.load(rules))
    with Recording(path, {"car/vehicle.yml": b"", **attachments(rules)}) as file:
        decision = drive.frame(cv=EDGES)
        file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)
    held = recall(path)
    assert held.rules_from == f"{name}, as recorded" and held.repeats(0)


def test_rules_given_by_hand_explain_the_whole_drive(tmp_path: Path) -> None:
    record_a_change(tmp_path / "drive.mcap")
    drive = recall(tmp_path / "drive.mcap", SHIPPED)
    assert [drive.repeats(i) for i in range(10)] == [True] * 5 + [False] * 5


def test_a_malformed_decision_counts_as_not_received_also_where_it_ends_in_zeros(tmp_path: Path) -> None:
    path, drive = tmp_path / "drive.mcap", Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:
        for k in range(5):
            decision = drive.frame(cv=EDGES)
            file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)
            if k == 2:
                for data in (bytes(400), to_cdr(decision)[:-1], b"no message"):
                    file.add(DECISION.key, data, at_s=decision.decided_s)
    told = recall(path)
    assert len(told.decisions) == len(list(told.decisions)) == 5


def damaged_in_its_middle(decision: Decision) -> bytes:
    """The bytes of a decision with an impossible length of the name of its cause."""
    data = to_cdr(decision)
    at = data.index(decision.cause.encode() + b"\0") - 4
    return data[:at] + b"\xff" * 4 + data[at + 4 :]


@pytest.fixture
def with_damage(tmp_path: Path) -> Path:
    """A recording of six decisions, of which the one 0.1 s after the start is damaged in its middle."""
    path, drive = tmp_path / "drive.mcap", Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:
        for k in range(6):
            decision = drive.frame(cv=EDGES)
            data = damaged_in_its_middle(decision) if k == 2 else to_cdr(decision)
            file.add(DECISION.key, data, at_s=decision.decided_s)
    return path


def test_a_decision_damaged_in_its_middle_counts_as_not_received_wherever_a_drive_is_explained(
    with_damage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = recall(with_damage)
    at_s = [float(one) for one in drive.t_s]
    assert len(drive.decisions) == 6
    answer = story(drive, at_s[2])
    assert (answer["moment_s"], answer["repeats"]) == (pytest.approx(at_s[1], abs=1e-3), True)
    assert overview(drive) == []
    assert capsys.readouterr().err.count(f"{with_damage}: 1 malformed decisions count as not received\n") >= 1


def test_drives_are_compared_without_a_decision_damaged_in_its_middle(with_damage: Path) -> None:
    found, _ = compare_drives(with_damage, with_damage)
    assert {row["name"]: row["a"] for row in found["figures"]}["decisions"] == 5


def test_a_recording_whose_decisions_are_all_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Recording(path, attachments(SHIPPED)) as file:
        decision = Drive.under_way().frame(cv=EDGES)
        file.add(DECISION.key, damaged_in_its_middle(decision), at_s=decision.decided_s)
    with pytest.raises(InputError, match="contains no decision of a supervisor"):
        story(recall(path), 0.0)


def with_vehicle_file(path: Path, text: bytes) -> Recall:
    """A recording of one decision by a car with this vehicle file."""
    with Recording(path, {"car/vehicle.yaml": text, **attachments(SHIPPED)}) as file:
        decision = Drive.under_way().frame(cv=EDGES)
        file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)
    return recall(path)


@pytest.mark.parametrize(
    ("text", "corridor"),
    [
        (b"# nothing of its own\n", "lane"),
        (b"wheelbase_m: 2.7\n", "lane"),
        (b"corridor: null\n", "lane"),
        (b"corridor: road\nroad_width_m: 7.0\n", "road"),
        (b"corridor: road\nof_another_version: 1\n", "road"),
        (b"\xef\xbb\xbfcorridor: road\n", "road"),
        ("corridor: road\n".encode("utf-16"), "road"),
    ],
)
def test_the_corridor_is_that_of_the_recorded_car_in_every_text_that_its_drive_would_read(
    tmp_path: Path, text: bytes, corridor: str
) -> None:
    assert with_vehicle_file(tmp_path / "drive.mcap", text).corridor == corridor


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (b"name: x\ncorridor: rode\n", "2:1: corridor: unknown value 'rode'; did you mean 'road'?"),
        (b"corridor: [\n", "2:1: not valid YAML: "),
        (b"- corridor\n", "1:1: expected a mapping of names to values"),
        (b"name: \xff\n", "1:7: byte 0xff is no UTF-8; save it as UTF-8"),
        (bytes(40), "1:1: holds only zero bytes, as after a loss of power"),
    ],
    ids=["misspelt", "cut", "list", "binary", "zero"],
)
def test_a_damaged_vehicle_file_of_a_recording_is_one_line_that_places_it_in_the_recording(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    text: bytes,
    fault: str,
) -> None:
    path = tmp_path / "drive.mcap"
    with_vehicle_file(path, text)
    monkeypatch.setattr(sys, "argv", ["trepid", "fear", "explain", str(path), "--at", "0"])
    assert main() == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{path}: car/vehicle.yaml:{fault}" in line


def test_a_fault_in_any_recorded_file_of_a_car_is_placed_in_the_recording(tmp_path: Path) -> None:
    recorded = RecordingContent(tmp_path / "drive.mcap", files={"car/camera.yaml": b"lens: square\n"})
    with pytest.raises(InputError, match=r"^\S+drive\.mcap: car/camera\.yaml:1:1: "), recorded_car(recorded):
        load(CONFIG_DIR / "camera.yaml", Camera)


def test_what_would_raise_fear_is_not_known_where_no_inputs_are_recorded(tmp_path: Path) -> None:
    path, drive = tmp_path / "drive.mcap", Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:
        decision = drive.frame(cv=ESTIMATE)
        bare = replace(decision, inputs=(), input_values=(), fear=0.0)
        file.add(DECISION.key, to_cdr(bare), at_s=decision.decided_s)
    answer = story(recall(path), 0.0)
    assert answer["raised_by"] is None and answer["next_level"] == "low"
    assert "what would raise fear to low is not known" in story_text(answer)


@pytest.mark.parametrize("late_s", [0.0, 0.0004, 0.0006])
def test_the_picture_of_a_moment_is_the_frame_of_its_decision(tmp_path: Path, late_s: float) -> None:
    """The time of the moment is rounded to 1 ms. The number of a frame is its brightness."""
    path, drive = tmp_path / "drive.mcap", Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:
        for k in range(1, 6):
            decision = drive.frame(cv=EDGES)
            assert decision.t_s is not None
            jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), 40 * k, np.uint8))[1].tobytes()
            frame = CompressedFrame(t_s=decision.t_s, jpeg=jpeg)
            file.add(CAMERA_COMPRESSED.key, to_cdr(frame), at_s=frame.t_s + 0.01)
            file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s + late_s)
    held = recall(path)
    answer = story(held, float(held.t_s[2]))
    (image,) = moment_figure(held, answer).axes[0].images
    assert np.mean(image.get_array()) == pytest.approx(40 * 3, abs=3)


@pytest.mark.parametrize(("speed_mps", "slowed_by"), [(None, None), (2.0, "controller")])
def test_an_unknown_speed_is_no_slow_down(
    tmp_path: Path, speed_mps: float | None, slowed_by: str | None
) -> None:
    path, drive = tmp_path / "drive.mcap", Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:
        for k in range(40):
            decision = drive.frame(cv=ESTIMATE, cnn=replace(ESTIMATE, estimator="cnn"))
            state = replace(STATE, t_s=decision.decided_s, speed_mps=8.0 if k < 20 else speed_mps)
            file.add(VEHICLE_STATE.key, to_cdr(state), at_s=decision.decided_s)
            file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)
    assert story(recall(path), 0.8)["slowed_by"] == slowed_by
