"""The processes of a drive: what a car needs before it starts."""

from dataclasses import replace
from pathlib import Path

import pytest
from driving_network_rig import write_network

from cockpit.car.init import Like, write_car
from drive.check import check_car
from drive.open_road import OpenRoad
from drive.plan import context_of, networks_in, plan_processes
from perception.lead.finder import check_lead
from sim_harness.live.course import ScenarioCourse
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import CAR, InputError
from trepid.processes.settings import check_vehicle, load_processes


@pytest.fixture
def shuttle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_car(tmp_path / "mycar", Like.SHUTTLE)
    monkeypatch.setenv(CAR, str(tmp_path / "mycar"))
    return tmp_path / "mycar"


def test_a_car_without_an_estimator_is_told_of_the_estimate_that_is_missing(shuttle: Path) -> None:
    specs = tuple(spec for spec in load_processes() if not spec.estimators)
    with pytest.raises(InputError, match="no process publishes an estimate"):
        OpenRoad().estimators(specs)


def test_a_car_without_a_process_at_the_actuator_is_refused(shuttle: Path) -> None:
    specs = tuple(spec for spec in load_processes() if not spec.is_vehicle)
    with pytest.raises(InputError, match="no process publishes vehicle/state"):
        check_vehicle(specs)


def test_the_detector_of_drawn_vehicles_is_refused_with_a_real_camera_only(shuttle: Path) -> None:
    specs = load_processes()
    check_lead(specs)  # the template leaves the process out
    lead = replace(specs[0], name="lead", module="perception.lead.node", publishes=("perception/lead",))
    with pytest.raises(InputError, match=r"lead\.yaml:\d+:\d+: detector: .*trepid detector list"):
        check_lead((*specs, lead))
    check_lead(plan_processes((*specs, lead), ScenarioCourse(load_scenario("straight"))))
    (shuttle / "lead.yaml").write_text("detector: objectron\n")
    check_lead((*specs, lead))


def test_a_driving_network_is_one_line_of_the_processes_of_a_car(shuttle: Path) -> None:
    write_network(shuttle / "turn.onnx")
    file = shuttle / "processes.yaml"
    line = "  mine: {module: perception.node, options: {estimator: mine, network: turn.onnx}}\n"
    file.write_text(file.read_text().replace("processes:\n", f"processes:\n{line}", 1))
    specs = plan_processes(load_processes(), OpenRoad())
    assert "mine" in OpenRoad().estimators(specs)
    assert networks_in(specs) == {"mine": str(shuttle / "turn.onnx")}
    check_car(specs)
    (shuttle / "turn.onnx").write_bytes(b"")
    with pytest.raises(InputError, match=r"mycar/turn\.onnx: is empty"):
        check_car(specs)


def test_chosen_estimators_replace_those_of_the_car_and_run_as_perception_processes(tmp_path: Path) -> None:
    network = str(tmp_path / "turn.onnx")
    specs = plan_processes(load_processes(), OpenRoad(chosen={"cv": None, "turn": network}))
    assert OpenRoad().estimators(specs) == ("cv", "turn")
    (turn,) = [spec for spec in specs if spec.name == "turn"]
    assert turn.options == {"statistics": False, "estimator": "turn", "network": network}
    assert context_of(OpenRoad(), ("cv", "turn"), 0, networks_in(specs))["networks"] == {"turn": network}
    alone = plan_processes(load_processes(), OpenRoad(chosen={"turn": network}))
    assert [spec.options["statistics"] for spec in alone if spec.estimators] == [True]
