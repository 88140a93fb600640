"""Several nodes in one process."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from trepid.config import CAR, InputError
from trepid.messages import Health
from trepid.processes.fused import gather_specs, run
from trepid.processes.settings import ProcessSpec

TURNS: list[str] = []


class NotingNode:
    """A node that notes its turns and reports its health."""

    def __init__(self, me: Any) -> None:
        self.me = me
        me.ready(values=lambda: ((f"value of {me.name}", "1"),))

    def due_s(self) -> float:
        return float(self.me.options["due_s"])

    def turn(self) -> None:
        TURNS.append(self.me.name)
        warns = self.me.options.get("warns", "")
        self.me.count_step(Health.WARN if warns else Health.OK, warns)


@contextmanager
def node(me: Any) -> Iterator[NotingNode]:
    yield NotingNode(me)


def run_fused(**options: dict[str, Any]) -> Any:
    """A process with the nodes ``options`` that stops after one round; holds what was reported."""
    module = sys.modules[__name__].__name__
    seen = SimpleNamespace(waits=[], states=[], values=())

    def ready(*, values: Any, realtime: int | None) -> None:
        seen.values, seen.realtime = values(), realtime

    def wait(*, timeout_s: float) -> None:
        seen.waits.append(timeout_s)

    rounds = iter((True, False))
    me: Any = SimpleNamespace(
        options={"nodes": [dict(name=name, module=module, options=own) for name, own in options.items()]},
        bus=SimpleNamespace(wait=wait),
        now_s=lambda: 0.0,
        restarts=0,
        running=lambda: next(rounds),
        ready=ready,
        count_step=lambda *state: seen.states.append(state),
    )
    TURNS.clear()
    run(me)
    return seen


def test_nodes_take_turns_in_the_order_of_the_options() -> None:
    run_fused(cv=dict(due_s=1), supervisor=dict(due_s=1), controller=dict(due_s=1))
    assert TURNS == ["cv", "supervisor", "controller"]


def test_the_process_waits_no_longer_than_the_node_that_is_due_first() -> None:
    assert run_fused(cv=dict(due_s=0.1), controller=dict(due_s=0.02)).waits == [0.02]


def test_the_one_heartbeat_has_the_worst_health_and_the_values_of_all_nodes() -> None:
    seen = run_fused(cv=dict(due_s=1, warns="no frames"), controller=dict(due_s=1))
    assert seen.states[-1] == (Health.WARN, "cv: no frames")
    assert seen.values == (("value of cv", "1"), ("value of controller", "1"))


def test_a_shared_process_has_the_highest_real_time_priority_of_its_nodes() -> None:
    assert run_fused(cv=dict(due_s=1), controller=dict(due_s=1)).realtime is None
    seen = run_fused(
        cv=dict(due_s=1, realtime=10),
        lead=dict(due_s=1, realtime=None),
        supervisor=dict(due_s=1),
        controller=dict(due_s=1, realtime=20),
    )
    assert seen.realtime == 20


def test_a_node_without_a_module_is_refused() -> None:
    with pytest.raises(ValueError, match="module"):
        run(SimpleNamespace(options={"nodes": [{"name": "cv"}]}))  # type: ignore[arg-type]


def spec(name: str, module: str = __name__, **fields: Any) -> ProcessSpec:
    return ProcessSpec(name, module, **{"together": "frame", **fields})


def test_entries_that_name_the_same_process_become_one() -> None:
    found = gather_specs(
        (
            spec("camera", "sim_harness.live.camera_node", together=""),
            spec(
                "cv",
                "perception.node",
                options={"estimator": "cv", "statistics": True},
                publishes=("perception/cv/estimate",),
            ),
            spec("controller", "controller.node", publishes=("controller/command",)),
        )
    )
    assert [one.name for one in found] == ["camera", "frame"]
    frame = found[1]
    assert [node["name"] for node in frame.options["nodes"]] == ["cv", "controller"]
    assert frame.options["nodes"][0]["options"] == {"estimator": "cv", "statistics": True}
    assert frame.publishes == (
        "perception/cv/estimate",
        "perception/image_statistics",
        "controller/command",
    )
    assert frame.module == "trepid.processes.fused"


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (spec("camera", "sim_harness.live.camera_node"), r"has no function node\(me\)"),
        (
            spec("vehicle", "vehicle.actuators.node", publishes=("vehicle/state",), place="p.yaml:3:3"),
            r"^p\.yaml:3:3: process vehicle: together: frame: it holds the limiter, which stops the car when"
            " another node hangs or ends",
        ),
        (spec("frame", "controller.node"), "needs a name of its own"),
        (spec("cv", "controller.node", together="observer"), "needs a name of its own, other than ca, cv, "),
    ],
)
def test_a_process_that_cannot_share_is_refused(wrong: ProcessSpec, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        gather_specs((wrong,))


@pytest.mark.parametrize("order", [1, -1])
def test_a_shared_process_with_the_name_of_another_process_is_refused(order: int) -> None:
    entries = (
        spec("supervisor", "supervisor.node", together=""),
        spec("cv", "perception.node", together="supervisor", place="p.yaml:2:9"),
    )
    with pytest.raises(
        InputError, match=r"^p\.yaml:2:9: process cv: together: supervisor: .* a name of its own"
    ):
        gather_specs(entries[::order])


@pytest.mark.parametrize("module", ["horn", "sounds.horn"])
def test_a_node_in_the_folder_of_the_car_can_share_a_process(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / f"{module.replace('.', '/')}.py"
    file.parent.mkdir(exist_ok=True)
    file.write_text('"""A horn."""\n\n\ndef node(me):\n    ...\n')
    monkeypatch.setenv(CAR, str(tmp_path))
    assert [one.name for one in gather_specs([spec("horn", module)])] == ["frame"]
