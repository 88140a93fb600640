"""Tuning changes only numbers, drives only checked candidates, continues after an interruption, judges fairly."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from sim_harness.scenarios.scenario import load_scenario
from sim_harness.sweep.plan import Plan, by_seeds, plan
from sim_harness.tuning.cli import check_start, difference, draw_cases, invalid_because, tune
from sim_harness.tuning.numbers import NumberedText
from sim_harness.tuning.score import Fearless, cases_with_rules, fearless, reference, score
from sim_harness.tuning.settings import Span, TuneSettings, parse_vary
from supervisor.rules.inference import FearRules
from supervisor.rules.sentence import load_rules
from supervisor.rules.verify import verify
from trepid.config import CONFIG_DIR, ROOT, InputError, load

optuna = pytest.importorskip("optuna", reason="needs pip install 'trepid[tune]'")
FILE = CONFIG_DIR / "fear.yaml"
TEXT = NumberedText(FILE)
SETTINGS = load(CONFIG_DIR / "tune.yaml", TuneSettings)
CORNER = "inputs.separation.corner.2"
QUICK = {"sight": "truth", "duration_s": "7"}
"""An estimator is biased from 5 s on; no picture is rendered."""


def data(text: str) -> dict:
    return YAML(typ="safe").load(text)


def quick_plan() -> Plan:
    return plan(by_seeds([load_scenario("lying_cv", QUICK)], [0]))


def test_the_default_tuned_numbers_are_in_the_shipped_file_and_setting_them_unchanged_keeps_it() -> None:
    check_start(FILE, dict(SETTINGS.parameters))
    same = TEXT.change_numbers({name: TEXT.value(name) for name in SETTINGS.parameters})
    assert data(same) == data(TEXT.text)
    assert same.count("\n") == TEXT.text.count("\n")


@pytest.mark.parametrize("value", [0.26, 0.3333, 0.44])
def test_only_the_number_changes_in_all_the_sets_where_it_stands(value: float) -> None:
    changed = TEXT.change_numbers({CORNER: value})
    old, new = TEXT.text.splitlines(), changed.splitlines()
    differing = [i for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    assert len(differing) <= 3
    sets = data(changed)["inputs"]["separation"]["sets"]
    assert sets["very_low"][3] == sets["low"][1] == sets["medium"][0] == value
    rest, before = data(changed), data(TEXT.text)
    rest["inputs"]["separation"]["sets"] = before["inputs"]["separation"]["sets"]
    assert rest == before


@pytest.mark.parametrize("quote", ["", "'", '"'])
@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("if a is low then fear is low", "if a is low then fear is low with weight 0.4"),
        ("if a is low then fear is low because x", "if a is low then fear is low with weight 0.4 because x"),
        (
            "if a is low then fear is low with weight 0.9 because x",
            "if a is low then fear is low with weight 0.4 because x",
        ),
    ],
)
def test_a_sentence_gets_its_weight_at_the_place_of_the_grammar(
    tmp_path: Path, sentence: str, expected: str, quote: str
) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(f"rules:\n  - {quote}{sentence}{quote}  # why\n")
    text = NumberedText(path)
    assert text.value("rules.0.weight") == (0.9 if "0.9" in sentence else 1.0)
    assert text.change_numbers({"rules.0.weight": 0.4}) == f"rules:\n  - {quote}{expected}{quote}  # why\n"


def test_a_weight_in_the_shipped_file_can_be_set_and_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    _, rules = load_rules(FILE)
    for number in (0, 7, len(rules) - 2):
        path.write_text(TEXT.change_numbers({f"rules.{number}.weight": 0.25}))
        changed = load_rules(path)[1]
        assert [r.weight for r in changed] == [0.25 if i == number else r.weight for i, r in enumerate(rules)]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("inputs.cnn_confidence.corner.1", r"sets is \*confidence, defined elsewhere"),
        ("inputs.nope.corner.1", "unknown name 'nope'; known: frame_age"),
        ("inputs.speed.corner.0", "the inner corners of speed are 1 to 5"),
        ("inputs.speed.corner.x", "the inner corners of speed are 1 to 5"),
        ("rules.999.weight", "unknown name '999'"),
        ("inputs.speed.unit", "is not a number"),
        ("fear", "is not a number"),
    ],
)
def test_an_unknown_name_is_refused_with_the_known_ones(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        TEXT.value(name)


@pytest.mark.parametrize("text", ["a", "a=1", "a=1..", "a=..2", "a=2..1", "a=x..y"])
def test_a_bad_span_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--vary a"):
        parse_vary([text])


@given(st.floats(-100, 100), st.floats(1e-3, 1e3), st.floats(0, 1))
def test_values_are_rounded_within_their_range(low: float, width: float, share: float) -> None:
    span = Span(low=low, high=low + width)
    value = low + share * width
    rounded = span.round_value(value)
    assert span.low <= rounded <= span.high
    assert abs(rounded - value) <= width / 100


@pytest.fixture(scope="module")
def fearless_drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Fearless]:
    """Rules without consequences of fear, and the drive with them."""
    path = fearless(FILE, tmp_path_factory.mktemp("fearless"))
    (case,) = cases_with_rules(path, quick_plan())
    return path, reference(case)


def test_the_reference_drives_without_the_consequences_of_fear_and_records_the_inputs_of_its_fear(
    fearless_drive: tuple[Path, Fearless],
) -> None:
    path, drive = fearless_drive
    assert FearRules.load(path).speed_factor(0.99) == 1.0
    fear = drive.fear_trace(FearRules.load(FILE))["decision.fear"]
    assert len(fear) == len(drive.t_s) > 150
    assert fear[np.array(drive.t_s) < 4.9].max() < 0.25 < fear[np.array(drive.t_s) > 5.2].max()


def test_a_score_counts_the_costs_of_fear(fearless_drive: tuple[Path, Fearless], tmp_path: Path) -> None:
    planned, drives = quick_plan(), [fearless_drive[1]]
    found = score(FILE, planned, drives, SETTINGS.costs)
    assert 0.0 < found.speed_loss < 0.5
    assert found.departures == 0
    costs = SETTINGS.costs
    assert found.cost == pytest.approx(
        costs.speed_loss * found.speed_loss
        + costs.nuisance_per_km * found.nuisance_per_km
        + (0.0 if found.auroc is None else costs.missed_warning * (1 - found.auroc))
    )
    braver = tmp_path / "braver.yaml"
    braver.write_text(TEXT.change_numbers({"fear.medium.speed_factor": 0.99, "fear.high.speed_factor": 0.9}))
    assert score(braver, planned, drives, costs).cost < found.cost


def test_fear_follows_the_recorded_inputs_of_a_drive() -> None:
    """A drive that departs just after the estimators had disagreed."""
    rules = FearRules.load(FILE)
    calm = {name: spec.calmest for name, spec in rules.inputs.items()}
    t_s = tuple(0.04 * i for i in range(500))
    rows = tuple(tuple({**calm, "disagreement": 4.0 if 10 < t < 12 else 0.0}.values()) for t in t_s)
    departures = tuple(int(t > 12.1) for t in t_s)
    drive = Fearless(8.0, t_s, departures, (8.0,) * len(t_s), tuple(calm), rows)
    fear = drive.fear_trace(rules)["decision.fear"]
    assert fear[260] > 0.5 > fear[100]


def test_a_run_that_raises_an_error_is_not_a_score_of_the_rules() -> None:
    nowhere = load_scenario("lying_cv", QUICK).model_copy(update={"road": "no_such_road"})
    with pytest.raises(InputError, match="no_such_road"):
        score(FILE, plan(by_seeds([nowhere], [0])), [], SETTINGS.costs)


def test_the_diff_shows_the_changed_lines_only() -> None:
    diff = difference(
        TEXT.text, TEXT.change_numbers({"hysteresis.band": 0.07}), "fear.yaml", "new.yaml"
    ).splitlines()
    assert [line[0] for line in diff] == ["-", "+", "@", "-", "+"]
    assert "0.07" in diff[-1] and diff[-1].endswith(diff[-2][diff[-2].index("#") :])


def test_the_validation_cases_differ_from_the_tuned_cases() -> None:
    assert not set(draw_cases({}, 3, ["lying_cv"], 0)) & set(draw_cases({}, 3, ["lying_cv"], 1))
    assert set(draw_cases({}, 3, ["lying_cv"], 0)) == set(draw_cases({}, 3, ["lying_cv"], 0))


def test_invalid_input_is_refused_before_the_first_run(tmp_path: Path) -> None:
    there = tmp_path / "there.yaml"
    there.write_text("")
    broken = tmp_path / "broken.yaml"
    broken.write_text(TEXT.text.replace("then fear is very_high", "then fear is high"))
    for arguments, message in (
        ({"file": FILE, "out": there}, "exists already"),
        ({"file": FILE, "out": tmp_path / "nowhere" / "x.yaml"}, "there is no folder"),
        ({"file": broken}, "must pass its check before it is tuned"),
        (
            {"file": FILE, "out": tmp_path / "x.yaml", "vary": ["hysteresis.band=0.1..0.15"]},
            "outside 0.1..0.15",
        ),
        ({"file": FILE, "out": tmp_path / "x.yaml", "scenarios": ["nope"]}, "no scenario 'nope'"),
        (
            {"file": FILE, "out": tmp_path / "x.yaml", "scenarios": ["lying_cv"], "unseen_seed": 0},
            "gives cases of the tuning",
        ),
    ):
        options = dict(settings=CONFIG_DIR / "tune.yaml", seed=0, unseen_seed=None, trials=1, workers=1)
        empty = dict(scenarios=None, unseen=None, cases=None, changes=None, vary=None, storage=None, out=None)
        with pytest.raises(InputError, match=message):
            tune(**{**options, **empty, "as_json": True, **arguments})  # type: ignore[arg-type]


def test_at_least_four_of_five_candidates_of_the_default_ranges_pass_the_checks(tmp_path: Path) -> None:
    rng, good = np.random.default_rng(0), 0
    for _ in range(10):
        spans = SETTINGS.parameters.items()
        values = {name: span.round_value(rng.uniform(span.low, span.high)) for name, span in spans}
        path = tmp_path / "candidate.yaml"
        path.write_text(TEXT.change_numbers(values), encoding="utf-8")
        try:
            good += not verify(FearRules.load(path)).problems
        except InputError:
            continue  # sets in disorder
    assert good >= 8


def test_reasons_of_invalid_candidates_are_counted_whatever_their_numbers() -> None:
    from sim_harness.tuning.study import INVALID

    def trial(state: str, said: str = "") -> Any:
        return SimpleNamespace(state=SimpleNamespace(name=state), user_attrs={INVALID: said} if said else {})

    trials = [
        trial("PRUNED", "/tmp/a1/candidate.yaml:7:3: corners of speed decrease"),
        trial("COMPLETE"),
        trial("PRUNED", "/tmp/a1/candidate.yaml:40:3: fear falls by 0.2 where risk rises"),
        trial("PRUNED", "/tmp/b2/candidate.yaml:41:3: fear falls by 0.35 where risk rises"),
    ]
    assert invalid_because(trials) == [
        {"count": 2, "first": "40:3: fear falls by 0.2 where risk rises"},
        {"count": 1, "first": "7:3: corners of speed decrease"},
    ]


def test_an_invalid_candidate_is_refused_without_being_driven(tmp_path: Path) -> None:
    from sim_harness.tuning.rule_study import RuleTask
    from sim_harness.tuning.study import Invalid

    task = RuleTask(
        rules=FILE,
        parameters={CORNER: Span(low=0.0, high=1.0)},
        planned={},
        references=[],
        costs=SETTINGS.costs,
        storage="unused",
        trials=1,
        seed=0,
        sampler="tpe",
    )
    with pytest.raises(Invalid, match="separation"):
        task.candidate({CORNER: 0.9}, tmp_path)  # beyond its neighbours
    assert not verify(FearRules.load(task.candidate({CORNER: 0.4}, tmp_path))).problems
    dearer = SETTINGS.costs.model_copy(update={"departure": 1.0})
    wider = {CORNER: Span(low=0.1, high=1.0)}
    others = [replace(task, parameters=wider), replace(task, costs=dearer)]
    assert len({other.name for other in (task, *others)}) == 3, "another question, another study"
    assert replace(task, trials=9, storage="x", seed=4).name == task.name


COMMAND = [
    *(sys.executable, "-m", "trepid", "fear", "tune"),
    *("--scenarios", "lying_cv", "--cases", "1", "--set", "sight=truth", "--set", "duration_s=7"),
    *("--vary", "fear.medium.speed_factor=0.5..1", "--vary", f"{CORNER}=0.2..0.6", "--seed", "5"),
    *("--workers", "2", "--unseen-seed", "99", "--json"),
]


@pytest.mark.processes
@pytest.mark.parametrize("kind", ["sqlite", pytest.param("journal", marks=pytest.mark.proof)])
def test_two_workers_tune_on_one_storage_and_resume_after_an_interruption(tmp_path: Path, kind: str) -> None:
    rules, new = tmp_path / "fear.yaml", tmp_path / "new.yaml"
    rules.write_text(TEXT.text)
    file = tmp_path / "study"
    storage = f"sqlite:///{file}" if kind == "sqlite" else str(file)
    command = [*COMMAND, str(rules), "--out", str(new), "--storage", storage]
    first = subprocess.Popen(
        [*command, "--trials", "60"], cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert first.stderr is not None
    for line in first.stderr:
        if " 2 of 60 trials" in line or " 3 of 60 trials" in line:
            break
    os.killpg(first.pid, signal.SIGINT)  # as a terminal does it: to everyone
    rest = first.stderr.read()
    assert first.wait(30) == 130
    assert "the same command continues" in rest and "Traceback" not in rest
    assert not new.exists()
    second = subprocess.run(
        [*command, "--trials", "4"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert second.returncode in (0, 1), second.stderr
    result = json.loads(second.stdout)
    assert result["trials"] >= 4
    counts = [
        int(line.split(": ")[1].split()[0]) for line in second.stderr.splitlines() if " of 4 trials" in line
    ]
    assert counts[0] >= 2, "results of the first session are kept"
    assert result["seen"]["after"]["cost"] <= result["seen"]["before"]["cost"]
    if result["out"]:
        assert not verify(FearRules.load(new)).problems
        assert data(new.read_text())["rules"] == data(TEXT.text)["rules"]
        unseen = result["unseen"]
        assert second.returncode == int(unseen["after"]["cost"] >= unseen["before"]["cost"])
    assert rules.read_text() == TEXT.text
