"""Rules that change while driving: valid ones take effect, invalid ones never, and the diagnostics report both."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from supervisor.rules.inference import FearRules
from supervisor.rules.reload import RuleChange, RuleWatch, reread
from supervisor.supervisor import build
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CONFIG_DIR
from trepid.messages import Health
from trepid.processes.launch import Fleet, ProcessSpec
from trepid.topics import DECISION, DIAGNOSTICS

SHIPPED = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
MARK = "if state_age is very_high then fear is very_high because demand"
MARKED = SHIPPED.replace("rules:\n", f"rules:\n  - {MARK}\n", 1)
TYPO = SHIPPED.replace("if state_age is very_high", "if stat_age is very_high", 1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "fear.yaml"
    file.write_text(SHIPPED, encoding="utf-8")
    return file


def until(condition: Callable[[], object], *, patience_s: float = 90) -> bool:
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        if condition():
            return True
        time.sleep(0.02)
    return False


def test_valid_rules_come_back_compiled_and_give_the_same_result_as_rules_loaded_here(path: Path) -> None:
    path.write_text(MARKED, encoding="utf-8")
    change, here = reread(path), FearRules.load(path)
    assert change.rules is not None
    assert change.error == ""
    for values in ({}, {name: spec.calmest for name, spec in here.inputs.items()}):
        assert change.rules.evaluate(values) == here.evaluate(values)


def test_rules_that_could_not_drive_come_back_as_one_line(path: Path) -> None:
    always = SHIPPED.replace("rules:\n", "rules:\n  - if speed is very_low then fear is high\n", 1)
    path.write_text(always, encoding="utf-8")
    change = reread(path)
    assert change.rules is None
    assert change.error.startswith(f"{path}:")
    assert "always fires" in change.error
    assert "\n" not in change.error


def test_valid_rules_are_handed_over_and_invalid_rules_are_reported() -> None:
    adopted: list[FearRules] = []
    rules = FearRules.load(CONFIG_DIR / "fear.yaml")
    assert RuleChange(rules, "").apply(adopted.append) == (Health.OK, "drives by changed rules")
    refused = RuleChange(None, "f:1:1: no").apply(adopted.append)
    assert refused == (Health.WARN, "old rules kept: f:1:1: no")
    assert adopted == [rules]


def test_rules_about_an_unmeasured_input_are_refused_and_the_old_rules_stay(path: Path) -> None:
    supervisor = build()
    path.write_text(SHIPPED.replace("state_age", "moon_phase"), encoding="utf-8")
    health, message = reread(path).apply(supervisor.adopt)
    assert health is Health.WARN
    assert "unknown input 'moon_phase'" in message
    decision = supervisor.step({}, None, None, None, now_s=0.0)
    assert "moon_phase" not in decision.inputs


def test_the_watch_reports_every_change_once_and_ends_with_its_thread(path: Path) -> None:
    with RuleWatch(path) as watch:
        assert watch.take() is None
        path.write_text(TYPO, encoding="utf-8")
        found: list[RuleChange] = []
        assert until(lambda: found.extend(filter(None, [watch.take()])) or found)
        assert "did you mean 'state_age'?" in found[0].error
        other = path.with_suffix(".new")  # as editors do it
        other.write_text(MARKED, encoding="utf-8")
        other.replace(path)
        assert until(lambda: found.extend(filter(None, [watch.take()])) or len(found) > 1)
        assert found[1].rules is not None
        assert watch.take() is None
    assert not any(thread.name == "rule-watch" for thread in threading.enumerate())


def test_an_edited_copy_that_appears_during_the_drive_counts(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "edited" / "fear.yaml"
    copy.parent.mkdir()
    with RuleWatch(path, copy) as watch:
        copy.write_text(MARKED, encoding="utf-8")
        found: list[RuleChange] = []
        assert until(lambda: found.extend(filter(None, [watch.take()])) or found)
        assert found[0].rules is not None and found[0].text == MARKED


@pytest.fixture
def wait_until(path: Path) -> Iterator[Callable[[Callable[[], bool]], bool]]:
    """A running supervisor process; waits for a condition on its last diagnostic and decision."""
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    spec = ProcessSpec(
        "supervisor",
        "supervisor.node",
        {"estimators": ["cv"], "cruise_speed_mps": 8.0, "rules": str(path)},
        max_restarts=0,
    )
    with (
        open_bus("car", epoch_clock(offset_ns), listen=endpoint) as bus,
        Fleet((spec,), vehicle_name="car", endpoint=endpoint, clock_offset_ns=offset_ns) as fleet,
    ):
        diagnostic, decided = bus.latest(DIAGNOSTICS), bus.latest(DECISION)

        def is_reached(condition: Callable[..., bool]) -> bool:
            def now() -> bool:
                return diagnostic.refresh() is not None and decided.refresh() is not None

            return (
                until(lambda: now() and condition(diagnostic.message, decided.message))
                and not fleet.collect_exits()
            )

        yield is_reached


def test_a_running_supervisor_keeps_valid_rules_reports_the_error_and_adopts_corrected_rules(
    path: Path, wait_until: Callable[[Callable[..., bool]], bool]
) -> None:
    assert wait_until(
        lambda diagnostic, decided: diagnostic.health is Health.OK and MARK not in decided.rules
    )
    path.write_text(TYPO.replace("rules:\n", f"rules:\n  - {MARK}\n", 1), encoding="utf-8")
    assert wait_until(
        lambda diagnostic, _: (
            diagnostic.health is Health.WARN and "did you mean 'state_age'?" in diagnostic.message
        )
    )
    assert wait_until(
        lambda diagnostic, decided: f"{path}:" in diagnostic.message and MARK not in decided.rules
    )
    path.write_text(MARKED, encoding="utf-8")
    assert wait_until(lambda diagnostic, decided: diagnostic.health is Health.OK and MARK in decided.rules)
