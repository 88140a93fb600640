"""The processes of a drive are settings; a car changes, replaces, adds and leaves out processes by an edit."""

from collections.abc import Callable
from pathlib import Path

import pytest

from trepid.config import CAR, InputError
from trepid.processes.settings import Loss, ProcessSpec, Restart, load_processes


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, ProcessSpec]]:
    """The processes of a car with this text in processes.yaml, by name."""
    monkeypatch.setenv(CAR, str(tmp_path))

    def load_specs(text: str) -> dict[str, ProcessSpec]:
        (tmp_path / "processes.yaml").write_text(text)
        return {spec.name: spec for spec in load_processes()}

    return load_specs


def test_the_defaults_are_the_processes_of_a_simulated_drive() -> None:
    specs = {spec.name: spec for spec in load_processes()}
    assert {"vehicle", "camera", "cv", "cnn", "lead", "supervisor", "controller"} <= specs.keys()
    assert specs["vehicle"].simulates
    assert (specs["vehicle"].restart, specs["cv"].restart) == (Restart.NEVER, Restart.ON_FAILURE)
    assert specs["cv"].publishes == ("perception/cv/estimate",)
    assert specs["cnn"].estimators == ("cnn",)


def test_a_process_of_null_is_left_out(car: Callable[[str], dict[str, ProcessSpec]]) -> None:
    assert "cnn" not in car("processes: {cnn: null}")


def test_single_fields_change_and_the_others_stay(car: Callable[[str], dict[str, ProcessSpec]]) -> None:
    cv = car("processes: {cv: {nice: 3, loss: slow}}")["cv"]
    assert (cv.nice, cv.loss) == (3, Loss.SLOW)
    assert (cv.module, cv.options) == ("perception.node", {"estimator": "cv"})


@pytest.mark.parametrize("entry", ["cnn: {<<: *d}", "cnn:\n    <<: *d", "cnn: {<<: [{cores: []}, *d]}"])
def test_merged_fields_change_an_entry_as_fields_of_its_own(
    car: Callable[[str], dict[str, ProcessSpec]], entry: str
) -> None:
    cnn = car(f"processes:\n  cv: &d {{nice: 5}}\n  {entry}\n")["cnn"]
    assert (cnn.nice, cnn.module) == (5, "perception.node")


def test_another_program_replaces_the_entry_as_a_whole(car: Callable[[str], dict[str, ProcessSpec]]) -> None:
    specs = car("processes: {vehicle: {module: controller.node}, cv: {command: [echo], loss: nothing}}")
    vehicle, cv = specs["vehicle"], specs["cv"]
    assert (vehicle.restart, vehicle.publishes, vehicle.simulates) == (Restart.ON_FAILURE, (), False)
    assert (cv.module, cv.options, cv.publishes) == ("", {}, ())


def test_another_program_has_its_own_options_and_none_of_the_replaced_one(
    car: Callable[[str], dict[str, ProcessSpec]],
) -> None:
    assert car("processes: {cv: {module: controller.node, options: {far: 1}}}")["cv"].options == {"far": 1}


def test_a_process_of_ones_own_is_added_with_the_defaults(
    car: Callable[[str], dict[str, ProcessSpec]], tmp_path: Path
) -> None:
    (tmp_path / "horn.py").write_text("")
    horn = car("defaults: {loss: nothing}\nprocesses: {horn: {module: horn}}")["horn"]
    assert (horn.loss, horn.place) == (Loss.NOTHING, f"{tmp_path}/processes.yaml:2:13")


def test_a_command_need_not_report_and_may(car: Callable[[str], dict[str, ProcessSpec]]) -> None:
    specs = car("processes: {a: {command: [echo]}, b: {command: [echo], heartbeat: true}}")
    assert (specs["a"].heartbeat, specs["b"].heartbeat) == (False, True)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "processes: {camra: {nice: 1}}",
            ":1:13: processes.camra: has no program: give module, command or entry_point; "
            "did you mean 'camera'?",
        ),
        (
            "processes: {horn: {module: no.horn}}",
            ":1:20: processes.horn.module: no module 'no.horn'; install its package, or put the file into the "
            "folder of the car",
        ),
        (
            "processes: {horn: {command: [no-horn]}}",
            ":1:20: processes.horn.command: no program 'no-horn'; install it, or give its whole path",
        ),
        (
            "processes: {horn: {entry_point: no-horn}}",
            ":1:20: processes.horn.entry_point: no entry point 'no-horn' in the group trepid.processes; "
            "no installed package adds one",
        ),
        (
            "processes: {horn: {command: [echo], module: controller.node}}",
            ":1:20: processes.horn.command: the process already has a module; a process has one program",
        ),
        (
            "processes: {two: {module: perception.node, options: {estimator: cv}}}",
            ":1:13: processes.two: process cv publishes perception/cv/estimate too; "
            "leave one of them out: cv: null",
        ),
        ("processes: {cv: {cores: [4096]}}", ":1:18: processes.cv.cores: this machine has no core 4096; "),
        (
            "processes: {cv: {options: {realtime: high}}}",
            ":1:28: processes.cv.options.realtime: 'high' is no priority; it is a whole number from 1 to 99",
        ),
        (
            "processes: {cv: {options: {realtime: 100}}}",
            ":1:28: processes.cv.options.realtime: 100 is no priority",
        ),
        (
            "processes: {cv: {options: {realtime: 0}}}",
            ":1:28: processes.cv.options.realtime: 0 is no priority",
        ),
        ("processes: {cv: {options: {realtime: 10.0}}}", ":1:28: processes.cv.options.realtime: 10.0 is no"),
        ("processes: {cv: {options: {realtime: true}}}", ":1:28: processes.cv.options.realtime: True is no"),
        (
            "processes: {cv: {loss: crash}}",
            ":1:18: processes.cv.loss: unknown value 'crash'; known here: stop, slow, nothing",
        ),
        ("processes: {cv: {<<: {loss: crash}}}", ":1:23: processes.cv.loss: unknown value 'crash'"),
        (
            "processes: {launcher: {command: [echo]}}",
            ":1:13: processes.launcher: is reserved: the certificate launcher.crt is another one's",
        ),
    ],
)
def test_a_wrong_entry_is_one_line_with_its_place_and_the_remedy(
    car: Callable[[str], dict[str, ProcessSpec]], tmp_path: Path, text: str, problem: str
) -> None:
    with pytest.raises(InputError) as raised:
        car(text)
    assert str(raised.value).startswith(f"{tmp_path}/processes.yaml{problem}")


@pytest.mark.parametrize(
    ("package", "code", "problem"),
    [
        ("divides", "1 / 0", "cannot be imported: ZeroDivisionError: division by zero"),
        ("needs", "import absent", "cannot be imported: ModuleNotFoundError: No module named 'absent'"),
    ],
)
def test_the_error_of_a_package_above_the_module_of_a_process_is_one_line(
    car: Callable[[str], dict[str, ProcessSpec]], tmp_path: Path, package: str, code: str, problem: str
) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").write_text(code)
    with pytest.raises(InputError) as raised:
        car(f"processes: {{horn: {{module: {package}.node}}}}")
    said = f"processes.horn.module: the package of '{package}.node' {problem}"
    assert str(raised.value) == f"{tmp_path}/processes.yaml:1:20: {said}"


def test_the_first_restart_comes_at_once_and_each_further_one_after_twice_the_time() -> None:
    spec = ProcessSpec("cv", "perception.node", backoff_s=0.5, longest_backoff_s=3.0)
    assert [spec.backoff_after_s(restarts) for restarts in range(6)] == [0.0, 0.5, 1.0, 2.0, 3.0, 3.0]


@pytest.mark.parametrize("backoff_s", [0.0, 0.5, 1e-9])
def test_the_time_before_a_restart_stays_finite_however_often_a_process_ends(backoff_s: float) -> None:
    spec = ProcessSpec("cv", "perception.node", backoff_s=backoff_s, longest_backoff_s=3.0)
    assert [spec.backoff_after_s(restarts) for restarts in (1025, 10**9)] == [min(3.0, 1e99 * backoff_s)] * 2


def test_modules_for_a_real_car_publish_their_topics_without_being_told(
    car: Callable[[str], dict[str, ProcessSpec]],
) -> None:
    specs = car(
        "processes:\n  vehicle: {module: vehicle.actuators.node}\n  camera: {module: vehicle.cameras.node}\n"
        "  driver: {module: vehicle.driver.node}\n"
    )
    assert specs["vehicle"].is_vehicle
    assert specs["camera"].publishes == ("camera/image", "camera/image/compressed")
    assert specs["driver"].publishes == ("driver/input",)
