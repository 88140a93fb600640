"""Inputs of fear of other packages: outside their range, failing or absent, they are missing values."""

import math
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from supervisor import supervisor
from supervisor.path.follow import NO_LEAD
from supervisor.situation import added
from supervisor.situation.added import FearInput, Moment, added_values, fear_input
from trepid import plugins
from trepid.config import CONFIG_DIR, InputError

NOW = Moment((), None, NO_LEAD, None, {"speed": 4.0}, 1.0)
INPUT = """
  wobble:
    meaning: a test
    unit: "1"
    range: [RANGE]
    risk: rising
    sets:
      very_low: [0.0, 0.0, 0.1, 0.2]
      low: [0.1, 0.2, 0.3]
      medium: [0.2, 0.3, 0.4]
      high: [0.3, 0.4, 0.5]
      very_high: [0.4, 0.5, 1.0, 1.0]
"""


@fear_input(low=0.0, high=1.0)
def wobble(moment: Moment) -> float | None:
    """A tenth of the speed."""
    speed_mps = moment.features["speed"]
    return None if speed_mps is None else speed_mps / 10


def no_input(moment: Moment) -> float:
    return 0.0


@pytest.fixture
def registered_input(monkeypatch: pytest.MonkeyPatch) -> None:
    register(monkeypatch, "wobble")


def register(monkeypatch: pytest.MonkeyPatch, function: str) -> None:
    """An entry point ``wobble`` for ``function`` of this file."""
    point = EntryPoint("wobble", f"{__name__}:{function}", plugins.Group.FEAR_INPUTS)
    found = {"wobble": wobble if function == "wobble" else no_input}
    monkeypatch.setattr(added, "added_entry_points", lambda group: {"wobble": point})
    monkeypatch.setattr(added, "part", lambda group, name, own: found[name])
    added._functions.cache_clear()


def rules_with(tmp_path: Path, span: str) -> Path:
    text = (
        (CONFIG_DIR / "fear.yaml")
        .read_text()
        .replace("\ninputs:\n", "\ninputs:" + INPUT.replace("RANGE", span), 1)
    )
    rule = "\nrules:\n  - if wobble is very_high then fear is very_high\n"
    path = tmp_path / "fear.yaml"
    path.write_text(text.replace("\nrules:\n", rule, 1))
    return path


def test_a_value_in_the_range_is_the_value_of_the_function(registered_input: None) -> None:
    assert added_values(("wobble", "speed"), NOW) == {"wobble": 0.4}


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.1, 1.1, None, "0.5"])
def test_a_value_that_is_none_in_the_range_is_missing(value: Any) -> None:
    assert FearInput(lambda moment: value, 0.0, 1.0)(NOW) is None


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError,
        KeyError,
        AttributeError,
        TypeError,
        ValueError,
        RuntimeError,
        OSError,
        StopIteration,
    ],
)
def test_an_error_in_the_function_is_a_missing_value_and_its_place_is_printed_once(
    error: type[Exception], capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(moment: Moment) -> float:
        raise error

    added._report.cache_clear()
    wrong = FearInput(fails, 0.0, 1.0)
    assert [wrong(NOW) for _ in range(3)] == [None] * 3
    place = f"{__file__}:{fails.__code__.co_firstlineno + 1}"
    assert capsys.readouterr().err == f"trepid: {place}: {error.__name__}: the fear input fails is missing\n"


def test_the_range_must_rise() -> None:
    with pytest.raises(ValueError, match="must rise"):
        fear_input(low=1.0, high=1.0)


def test_rules_may_name_the_input(registered_input: None, tmp_path: Path) -> None:
    assert supervisor.build(rules=rules_with(tmp_path, "0.0, 1.0"))


def test_the_range_in_the_rules_must_contain_that_of_the_function(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    register(monkeypatch, "wobble")
    monkeypatch.setattr(added, "part", lambda *_: FearInput(lambda moment: 0.0, 0.0, 5.0))
    with pytest.raises(
        InputError, match=r"fear.yaml:\d+:5: inputs.wobble.range: wobble has values from 0 to 5;"
    ):
        supervisor.build(rules=rules_with(tmp_path, "0.0, 1.0"))


def test_an_entry_point_that_is_no_fear_input_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    register(monkeypatch, "no_input")
    with pytest.raises(InputError, match="is no fear input; decorate"):
        supervisor.build(rules=rules_with(tmp_path, "0.0, 1.0"))


def test_without_the_entry_point_the_rules_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fear.yaml:\d+:3: inputs.wobble: unknown input"):
        supervisor.build(rules=rules_with(tmp_path, "0.0, 1.0"))
