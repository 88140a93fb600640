"""``trepid sim run`` as a process of its own: killed, interrupted, resumed, and with options that do not fit."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from sim_harness.cli import app
from sim_harness.sweep.fingerprint import hash_of_files
from trepid.config import ROOT, InputError

pytestmark = pytest.mark.long
SECOND = """\
description: a second of the straight, without pictures
tags: [nominal]
road: straight
duration_s: 1.0
sight: truth
expect: {must_stand: true}
"""
ENDLESS = SECOND.replace("duration_s: 1.0", "duration_s: 36000\ndistance_m: 1e9").replace(
    "straight", "circuit"
)
PATIENCE_S = 60.0


@pytest.fixture
def files(tmp_path):
    """A scenario of a second, and a scenario that does not end by itself."""
    for name, text in (("second", SECOND), ("endless", ENDLESS)):
        (tmp_path / f"{name}.yaml").write_text(text)
    return tmp_path


def sim(*arguments):
    return app([str(argument) for argument in arguments], standalone_mode=False)


@pytest.fixture
def start():
    """Start the command in a session of its own, so that a signal can reach all of it, as from a keyboard."""
    commands = []

    def start(*arguments):
        command = [sys.executable, "-m", "trepid", "sim", "run", *map(str, arguments)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        commands.append(subprocess.Popen(command, cwd=ROOT, text=True, start_new_session=True, **pipes))
        return commands[-1]

    yield start
    for command in commands:
        with command, suppress(ProcessLookupError):  # also those left by a failed test
            os.killpg(command.pid, signal.SIGKILL)


def wait_for_lines(path, count):
    """Wait until ``path`` has ``count`` lines; the time is not checked."""
    until_s = time.monotonic() + PATIENCE_S
    while not path.exists() or path.read_bytes().count(b"\n") < count:
        assert time.monotonic() < until_s, "the sweep does not get on"
        time.sleep(0.02)


def wait_until_gone(session):
    """Wait until no process of the session is left."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        try:
            os.killpg(session, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    raise AssertionError("processes are left")


def hashes(text):
    return [(row["seed"], row["trace_sha256"]) for row in map(json.loads, text.splitlines())]


def test_a_killed_sweep_resumes_at_its_last_case(files, start, capsys):
    stored = files / "out.jsonl"
    sources = (files / "second.yaml", "--seeds", 3)
    command = start(*sources, files / "endless.yaml", "--out", stored)
    wait_for_lines(stored, 3)
    os.killpg(command.pid, signal.SIGKILL)
    command.communicate()
    with stored.open("a") as file:
        file.write('{"case": "half a li')
    assert sim("run", *sources, "--json") == 0
    expected = hashes(capsys.readouterr().out)
    with pytest.raises(InputError, match="holds results"):
        sim("run", *sources, "--out", stored)
    capsys.readouterr()
    hash_of_files.cache_clear()  # as in a new process
    assert sim("run", files / "second.yaml", "--seeds", 5, "--out", stored, "--resume", "--json") == 0
    out, err = capsys.readouterr()
    assert "3 of 5 cases are stored and not run again" in err
    assert "[5/5] second seed 4: passed" in err and "second seed 2:" not in err
    assert hashes(out)[:3] == expected[:3]
    assert [json.loads(line)["seed"] for line in out.splitlines()] == [0, 1, 2, 3, 4]


def test_ctrl_c_ends_all_processes_and_keeps_finished_results(files, start):
    stored = files / "out.jsonl"
    command = start(
        files / "second.yaml", files / "endless.yaml", "--seeds", 2, "--jobs", 2, "--out", stored, "--json"
    )
    wait_for_lines(stored, 2)
    os.killpg(command.pid, signal.SIGINT)
    out, err = command.communicate(timeout=PATIENCE_S)
    assert command.returncode == 130
    assert f"interrupted: 2 of 4 cases are done, stored in {stored}; --resume continues" in err
    assert "Traceback" not in err
    assert [row[0] for row in hashes(out)] == [0, 1]
    wait_until_gone(command.pid)


def test_rows_come_in_the_order_of_the_plan_with_any_number_of_processes(files, capsys):
    (files / "longer.yaml").write_text(SECOND.replace("1.0", "8"))
    outputs = []
    for jobs in (1, 2):
        sim("run", files / "longer.yaml", files / "second.yaml", "--seeds", 2, "--jobs", jobs, "--json")
        outputs.append([json.loads(line) for line in capsys.readouterr().out.splitlines()])
    for row in outputs[0] + outputs[1]:
        del row["realtime_factor"]
    assert [(row["scenario"], row["seed"]) for row in outputs[0]] == [
        ("longer", 0),
        ("longer", 1),
        ("second", 0),
        ("second", 1),
    ]
    assert outputs[0] == outputs[1]


def test_sampled_cases_report_their_values_and_repeat_with_their_seed(files, capsys):
    path = files / "vary.yaml"
    path.write_text(SECOND + "vary:\n  start.offset_m: [-0.3, 0.3]\n")
    drawn = []
    for _ in range(2):
        assert sim("run", path, "--sample", "random", "--cases", 2, "--seed", 7, "--json") == 0
        drawn.append([json.loads(line) for line in capsys.readouterr().out.splitlines()])
    assert [r["parameters"] for r in drawn[0]] == [r["parameters"] for r in drawn[1]]
    assert drawn[0][0]["parameters"] != drawn[0][1]["parameters"]
    assert [r["trace_sha256"] for r in drawn[0]] == [r["trace_sha256"] for r in drawn[1]]


def test_a_random_seed_is_printed_and_repeats_the_run(files, capsys):
    sim("run", files / "second.yaml", "--seed", "random", "--json")
    out, err = capsys.readouterr()
    seed = json.loads(out)["seed"]
    assert f"--seed {seed} repeats it" in err
    sim("run", files / "second.yaml", "--seed", seed, "--json")
    assert hashes(capsys.readouterr().out) == hashes(out)


def test_a_report_holds_every_run_also_those_of_an_earlier_sweep(files, capsys):
    stored, page = files / "out", files / "page.html"
    sim("run", files / "second.yaml", "--out", stored)
    sim("run", files / "second.yaml", "--seeds", 2, "--out", stored, "--resume", "--report", page)
    text = page.read_text()
    assert f"trepid sim run {files / 'second.yaml'} --seed 0" in text
    assert f"trepid sim run {files / 'second.yaml'} --seed 1" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no scenario given"),
        (["straight", "--cases", "3"], "--cases needs --sample"),
        (["straight", "--sample", "grid", "--seeds", "2"], "--seeds cannot be given too"),
        (["straight", "--resume"], "--resume needs --out"),
        (["straight", "--resume", "--out", "x.jsonl", "--seed", "random"], "--resume needs fixed seeds"),
        (["straight", "--jobs", "2", "--cluster", "tcp://localhost:1"], "--jobs cannot be given too"),
        (["straight", "--seed", "-1"], "--seed -1: expected a whole number"),
        (["straight", "--seed", "1e3"], "--seed 1e3: expected a whole number"),
        (["straight", "--out", "x.csv"], "x.csv: expected a folder"),
        (["straight", "--report", "/no/such/folder/x.html"], "there is no folder /no/such/folder"),
    ],
)
def test_options_that_do_not_fit_are_refused_in_a_line(arguments, message):
    with pytest.raises(InputError, match=message):
        sim("run", *arguments)
