"""The nodes of a recorded drive give the recorded outputs again, bit for bit, and a changed rule shows."""

import json
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from driving_network_rig import write_network
from foreign_ros_rig import damage_chunk
from recorded_rig import record_drive
from typer.testing import CliRunner

from cockpit.logbook.recall import recall
from cockpit.replay.nodes import Inputs, nodes_of, settings_of
from cockpit.replay.rerun import Rerun, rerun
from cockpit.replay.tape import Tape
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.road_users import Cross, RoadUser
from sim_harness.scenarios.scenario import load_scenario
from trepid.cli import app
from trepid.config import CONFIG_DIR, InputError, car_folder, use_car
from trepid.messages import Mode, Steps
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording, attachments
from trepid.topics import COMMAND, DECISION, LOSSES, STEPS, VEHICLE_STATE
from trepid.wire import to_cdr

pytestmark = pytest.mark.long
UNSEEN = load_scenario("lying_cv", {"sight": "truth", "duration_s": "7"})
SEEN = load_scenario("straight", {"duration_s": "1"})
WALKING = RoadUser(
    gap_m=35.0,
    offset_m=-3.0,
    facing_rad=1.5,
    phases=(Cross(kind="cross", at_gap_m=25.0, to_offset_m=0.0, speed_mps=1.4),),
)


@pytest.fixture(scope="module")
def unseen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("unseen") / "drive.mcap"
    return record_drive(path, UNSEEN, seed=3)


@pytest.fixture(scope="module")
def seen_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with raw images."""
    path = tmp_path_factory.mktemp("seen") / "drive.mcap"
    return record_drive(path, SEEN, raw_images=True)


@pytest.fixture
def timid(tmp_path: Path) -> Path:
    """Rules whose medium fear is greater than that of the shipped ones."""
    shipped = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    changed = shipped.replace("medium:    {at: 0.5, ", "medium:    {at: 0.6, ")
    assert changed != shipped
    path = tmp_path / "timid.yaml"
    path.write_text(changed, encoding="utf-8")
    return path


def same(found: Rerun) -> bool:
    return all(one.compared and not one.different for one in found.topics.values())


def test_every_node_repeats_a_lock_step_run_bit_for_bit(seen_drive: Path) -> None:
    found = rerun(seen_drive, ["all"])
    assert {key.split("/")[1] for key in found.topics} == {
        *("cv", "cnn", "image_statistics", "lead", "road_users", "decision", "command")
    }
    assert same(found) and found.first is None and not found.left_out
    assert set(found.doubts.values()) == {""}


def test_the_supervisor_waits_for_the_same_person_again(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    crossed = load_scenario("straight", {"duration_s": "8", "sight": "truth", "road_user_sensor": "modelled"})
    record_drive(path, crossed.model_copy(update={"road_users": (WALKING,)}))
    decisions = read_recording(path, DECISION.key).of(DECISION)
    assert any(decision.road_user == "person" for _, decision in decisions)
    assert same(rerun(path, ["supervisor", "controller"]))


def test_supervisor_and_controller_repeat_a_drive_with_stops_from_its_estimates(unseen: Path) -> None:
    found = rerun(unseen, ["supervisor", "controller"])
    assert same(found)
    assert found.topics[DECISION.key].compared == len(read_recording(unseen, DECISION.key).of(DECISION))


def test_without_raw_images_all_leaves_out_the_nodes_that_see_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "jpeg.mcap"
    record_drive(path, SEEN)
    with monkeypatch.context() as without:
        without.delattr(subprocess, "Popen")  # no process is started for estimators that do not run
        found = rerun(path, ["all"])
    assert set(found.left_out) == {"cv", "cnn", "statistics", "lead", "road_users"}
    assert same(found) and set(found.topics) == {DECISION.key, COMMAND.key}
    by_jpeg = rerun(path, ["cv"])
    assert "JPEG" in by_jpeg.doubts["perception/cv/estimate"]
    assert 0 < by_jpeg.topics["perception/cv/estimate"].compared < 100


def test_a_recording_with_a_corrupted_chunk_is_run_again_behind_it_with_the_number_of_lost_messages(
    unseen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "damaged.mcap"
    path.write_bytes(unseen.read_bytes())
    damage_chunk(path, 8)
    found, whole = (rerun(one, ["supervisor", "controller"]) for one in (path, unseen))
    assert found.drive_s == whole.drive_s and found.lost > 0 and not whole.lost
    assert 0 < whole.topics[DECISION.key].compared - found.topics[DECISION.key].compared < 20
    assert f"{found.lost} messages are lost in corrupted parts" in found.doubts[DECISION.key]
    assert capsys.readouterr().err.count("are corrupted") == 1


def test_a_changed_rule_is_judged_on_the_recorded_drive(unseen: Path, timid: Path, tmp_path: Path) -> None:
    out = tmp_path / "new.mcap"
    found = rerun(unseen, ["supervisor"], rules=timid, out=out)
    assert found.first is not None and found.first.topic == DECISION.key
    assert found.topics[DECISION.key].greatest["fear"].replayed != 0.0
    told = recall(out)
    assert all(told.repeats(index) for index in range(len(told.decisions)))
    recorded = recall(unseen)
    at = recorded.index_at(found.first.t_s)
    assert told.decisions[at] != recorded.decisions[at]
    assert told.decisions[:at] == recorded.decisions[:at]
    assert same(rerun(out, ["supervisor"])), "the new recording repeats itself"


def test_a_changed_message_is_found_with_its_time_field_and_values(unseen: Path, tmp_path: Path) -> None:
    states = read_recording(unseen, VEHICLE_STATE.key).of(VEHICLE_STATE)
    wrong = replace(states[700][1], speed_mps=0.0)
    path = rewritten(unseen, tmp_path / "wrong.mcap", {700: wrong})
    found = rerun(path, ["controller"])
    assert found.first is not None
    assert found.first.topic == COMMAND.key
    assert found.first.t_s == pytest.approx(states[700][0] - 1000.0, abs=0.05)
    assert found.first.recorded != found.first.replayed


def rewritten(source: Path, out: Path, states: dict[int, Any]) -> Path:
    """``source`` with other states of the vehicle, by their number."""
    held = read_recording(source)
    count = 0
    with Recording(out, held.files, held.notes) as file:
        for log_ns, key, data in in_order(source):
            changed = states.get(count) if key == VEHICLE_STATE.key else None
            count += key == VEHICLE_STATE.key
            file.add(key, data if changed is None else to_cdr(changed), at_s=log_ns / 1e9)
    return out


def test_a_recording_from_the_middle_of_a_drive_is_warmed_up_and_not_called_exact(
    unseen: Path, tmp_path: Path
) -> None:
    held = read_recording(unseen)
    part = tmp_path / "part.mcap"
    notes = {name: text for name, text in held.notes.items() if not name.startswith("lockstep")}
    with Recording(part, held.files, notes) as file:
        for log_ns, key, data in in_order(unseen):
            if log_ns > 1002e9:
                file.add(key, data, at_s=log_ns / 1e9)
    found = rerun(part, ["supervisor"])
    decisions = read_recording(part, DECISION.key).of(DECISION)
    assert 0 < found.topics[DECISION.key].compared < len(decisions)
    assert found.doubts[DECISION.key]
    modes = [change.replayed for change in found.topics[DECISION.key].modes]
    assert Mode.STOP not in modes, "the supervisor leaves the STOP in which it starts"


def test_the_car_of_the_recording_is_in_use_during_a_replay_and_no_longer(tmp_path: Path) -> None:
    car = tmp_path / "car"
    car.mkdir()
    (car / "vehicle.yaml").write_text("wheelbase_m: 2.0\n")
    use_car(car)
    try:
        path = tmp_path / "drive.mcap"
        scenario = load_scenario("lying_cv", {"sight": "truth", "duration_s": "3"})
        record_drive(path, scenario)
    finally:
        use_car(None)
    assert same(rerun(path, ["controller"]))
    assert car_folder() is None
    (car / "vehicle.yaml").write_text("wheelbase_m: 3.0\n")
    use_car(car)
    try:
        assert not same(rerun(path, ["controller"])), "a car that is given replaces that of the recording"
    finally:
        use_car(None)


def test_the_inputs_of_a_live_step_are_those_that_its_report_names(unseen: Path, tmp_path: Path) -> None:
    """Reports that name older states give the commands of older states."""
    held = read_recording(unseen, "*", "*/*", "*/*/*")
    notes = {name: text for name, text in held.notes.items() if not name.startswith("lockstep")}
    path = tmp_path / "late.mcap"
    decisions, states = held.of(DECISION), held.of(VEHICLE_STATE)
    commands = held.of(COMMAND)

    def reads() -> Iterator[float | None]:
        for at_s, _ in commands:
            yield max((t_s for t_s, _ in decisions if t_s <= at_s), default=None)
            yield max((t_s for t_s, _ in states if t_s <= at_s - 0.03), default=None)

    with Recording(path, held.files, notes) as file:
        for log_ns, key, data in in_order(unseen):
            file.add(key, data, at_s=log_ns / 1e9)
        report = Steps(
            t_s=2000.0,
            process="controller",
            first=0,
            outputs=(COMMAND.key,),
            inputs=(DECISION.key, VEHICLE_STATE.key),
            began_s=tuple(at_s for at_s, _ in commands),
            read_s=tuple(reads()),
            broken=(),
        )
        file.add(STEPS.key, to_cdr(report), at_s=2000.0)
    found = rerun(path, ["controller"])
    assert found.doubts[COMMAND.key] == ""
    assert found.topics[COMMAND.key].compared == len(commands)
    assert found.topics[COMMAND.key].different > 100


def test_malformed_losses_raise_no_fear_as_in_a_drive(unseen: Path) -> None:
    tape = Tape(unseen)
    with settings_of(tape, None) as setup:
        node = nodes_of(tape, setup)["supervisor"]
        nothing = dict.fromkeys((topic.key for topic in node.inputs), None)
        sound, torn = (node.build()(Inputs(nothing, 1000.0, broken)) for broken in ((), (LOSSES.key,)))
    assert repr(torn) == repr(sound)


@pytest.fixture(scope="module")
def network_drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording with raw images of a drive with a driving network, and the file of the network."""
    folder = tmp_path_factory.mktemp("networked")
    network = write_network(folder / "turn.onnx", gain_rad=0.1, memory=True)
    scenario = load_scenario("straight", {"duration_s": "1", **changes_of(["cv", str(network)])})
    record_drive(folder / "drive.mcap", scenario, raw_images=True)
    return folder / "drive.mcap", network


def test_a_driving_network_repeats_its_drive_from_the_file_that_the_recording_names(
    network_drive: tuple[Path, Path],
) -> None:
    found = rerun(network_drive[0], ["all"])
    assert "perception/turn/estimate" in found.topics and not found.left_out
    assert same(found)


def test_another_network_is_judged_on_the_recorded_drive(
    network_drive: tuple[Path, Path], tmp_path: Path
) -> None:
    other = write_network(tmp_path / "turn.onnx", gain_rad=0.2, memory=True)
    found = rerun(network_drive[0], ["all"], networks=[str(other)])
    assert found.topics["perception/turn/estimate"].different > 0
    assert found.topics["perception/cv/estimate"].different == 0
    with pytest.raises(
        InputError, match=r"--estimator .*swerve\.onnx: no driving network 'swerve' in the rec"
    ):
        rerun(network_drive[0], ["all"], networks=[str(other.rename(tmp_path / "swerve.onnx"))])


def test_a_network_that_has_changed_is_left_out_and_named(network_drive: tuple[Path, Path]) -> None:
    path, network = network_drive
    kept = network.read_bytes()
    for state, changed in (("has changed since", b"other"), ("is not there any more", None)):
        try:
            network.unlink()
            if changed is not None:
                network.write_bytes(changed)
            found = rerun(path, ["all"])
            assert state in found.left_out["turn"] and "--estimator turn.onnx" in found.left_out["turn"]
            assert same(found) and "perception/cv/estimate" in found.topics
            with pytest.raises(InputError, match=state):
                rerun(path, ["turn"])
        finally:
            network.write_bytes(kept)


def run_replay(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["replay", *arguments], standalone_mode=False)
    if isinstance(result.exception, InputError):
        raise result.exception
    return result.return_value or 0, result.stdout


def test_json_gives_frames_differences_and_the_first_one(unseen: Path, timid: Path) -> None:
    code, text = run_replay(str(unseen), "--through", "supervisor", "--json")
    row = json.loads(text)
    assert (code, row["differences"], row["first_difference"]) == (0, 0, None)
    assert row["frames"] > 200
    code, text = run_replay(str(unseen), "--through", "supervisor", "--rules", str(timid), "--json")
    row = json.loads(text)
    assert code == 1 and row["differences"] > 0
    assert set(row["first_difference"]) == {"t_s", "topic", "field", "recorded", "replayed"}


def test_the_text_names_what_differs_and_when(unseen: Path, timid: Path) -> None:
    code, text = run_replay(str(unseen), "--through", "all", "--rules", str(timid))
    assert code == 1
    assert "supervisor/decision" in text and "first at " in text and "greatest at " in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--through", "supervisr"], r"--through supervisr: did you mean 'supervisor'\?"),
        (["--out", "x.mcap"], "need --through"),
        (["--through", "cv"], r"--through cv: "),
    ],
)
def test_bad_input_is_one_line(unseen: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    path = unseen
    if arguments == ["--through", "cv"]:
        path = tmp_path / "none.mcap"
        with Recording(path, attachments(CONFIG_DIR / "fear.yaml")) as file:
            for at_s, decision in read_recording(unseen, DECISION.key).of(DECISION)[:3]:
                file.add(DECISION.key, to_cdr(decision), at_s=at_s)
    with pytest.raises(InputError, match=message):
        run_replay(str(path), *arguments)


def test_a_recording_without_decisions_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with Recording(path):
        pass
    with pytest.raises(InputError, match="nothing to run again"):
        rerun(path, ["all"])
    existing = tmp_path / "there.mcap"
    existing.write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        run_replay(str(path), "--through", "all", "--out", str(existing))
