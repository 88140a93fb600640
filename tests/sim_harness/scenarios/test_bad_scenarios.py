"""Bad scenario files: exit code 2 and one line, with file:line:column where there is a line; never a traceback."""

import copy
import io
import sys

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

import trepid.cli
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid.config import CONFIG_DIR, InputError

GOOD = "description: a test\ntags: [nominal]\nroad: straight\nduration_s: 10\n"


def with_duration(text):
    return GOOD.replace("10", text)


BAD = {
    # No YAML mapping at all.
    "missing": (None, "bad.yaml: cannot be read: No such file"),
    "empty": ("", ":1:1: expected a mapping"),
    "only a comment": ("# nothing\n", ":1:1: expected a mapping"),
    "binary": (b"\x00\x01\xff\xfe\x80", ":1:3: byte 0xff is no UTF-8"),
    "control character": (GOOD + "name: a\x07b\n", "unacceptable character #x0007"),
    "list": ("- a\n", ":1:1: expected a mapping"),
    "number": ("3\n", ":1:1: expected a mapping"),
    # No YAML.
    "path of Windows": (
        GOOD + 'start: "C:\\Users\\a"\n',
        ":5:13: not valid YAML: a backslash in double quotes",
    ),
    "tab": (GOOD + "start:\n\toffset_m: 1\n", ":6:1: not valid YAML: a tab; write spaces"),
    "unclosed brace": (GOOD + "start: {offset_m: 1\n", ":6:1: not valid YAML: "),
    "unclosed quote": (GOOD + 'name: "abc\n', ":6:1: not valid YAML: "),
    "duplicate key": (GOOD + "road: curve\n", ":5:1: not valid YAML: .*duplicate key"),
    "colon in text": ("description: a: b\n", ":1:15: not valid YAML: "),
    "unknown alias": (GOOD + "start: *nowhere\n", ":5:8: not valid YAML: .*alias"),
    "merge of no mapping": (GOOD + "start: {<<: 3}\n", ":5:13: not valid YAML: "),
    "two documents": (GOOD + "---\n" + GOOD, ":5:1: not valid YAML: .*document"),
    "tag": (GOOD + "start: !!python/object:os.system {}\n", ":5:8: not valid YAML: unknown tag .*os.system"),
    "tag of the wrong kind": (GOOD + "start: !!set x\n", ":5:8: not valid YAML: unknown tag"),
    "mapping in a mapping as key": (
        GOOD + "? {{a: b}: c}\n: 4\n",
        ":5:3: not valid YAML: a mapping cannot name",
    ),
    "impossible date": (GOOD.replace("a test", "2020-13-45"), "not valid YAML: month must be"),
    "number of 5000 digits": (with_duration("1" * 5000), "bad.yaml: not valid YAML: "),
    "nested 500 deep": (GOOD + "start: " + "{a: " * 500 + "1" + "}" * 500, "bad.yaml: nested too deeply"),
    # Fields.
    "unknown field": (GOOD + "duraton_s: 3\n", ":5:1: unknown field 'duraton_s'; did you mean 'duration_s'"),
    "unknown field below": (
        GOOD + "start: {offset: 1}\n",
        ":5:9: unknown field 'start.offset'; did you mean",
    ),
    "unknown field in letters of elsewhere": (GOOD + "dürätion_s: 3\n", ":5:1: unknown field 'dürätion_s'"),
    "missing field": (GOOD.replace("road: straight\n", ""), ":1:1: road: a scenario needs a road"),
    "number as key": (GOOD + "3: 4\n", ":5:1: 3: Keys should be strings"),
    "list as key": (GOOD + "? [a, b]\n: 4\n", ":5:3: not valid YAML: a sequence cannot name"),
    # Values.
    "word for a number": (with_duration("long"), ":4:1: duration_s: .*valid number"),
    "nothing for a number": (with_duration(""), ":4:1: duration_s: .*valid number"),
    "list for a number": (with_duration("[10]"), ":4:1: duration_s: .*valid number"),
    "mapping for a number": (with_duration("{a: 1}"), ":4:1: duration_s: .*valid number"),
    "negative duration": (with_duration("-10"), ":4:1: duration_s: .*greater than or equal to 0.1"),
    "duration shorter than two samples": (
        with_duration("5e-324"),
        ":4:1: duration_s: .*greater than or equal to 0.1",
    ),
    "start too slow for a driver": (
        GOOD + "start: {speed_mps: 5e-324}\n",
        ":5:9: start.speed_mps: expected 0 or at least 0.1 m/s",
    ),
    "infinite duration": (with_duration(".inf"), ":4:1: duration_s: .*finite"),
    "duration that is no number": (with_duration(".nan"), ":4:1: duration_s: .*finite"),
    "duration beyond the age of the world": (with_duration("1e308"), ":4:1: duration_s: .*86400"),
    "recursive alias": (GOOD + "start: &x {offset_m: *x}\n", ":5:12: start.offset_m: "),
    "impossible tag": (GOOD.replace("nominal", "Nominal!"), ":2:8: tags.0: String should match pattern"),
    "no tags": (GOOD.replace("nominal", ""), ":2:1: tags: "),
    # The road.
    "unknown road": (
        GOOD.replace("straight", "strait"),
        ":3:1: road: no road 'strait'; did you mean 'straight'",
    ),
    "road file that is not there": (GOOD.replace("straight", "no.yaml"), "no.yaml: cannot be read"),
    "road file that is no road": (GOOD.replace("straight", "bad.yaml"), ":1:1: unknown field 'description'"),
    "curvature that jumps": (
        GOOD + "segments: [{length_m: 9}, {length_m: 9, curvature_1pm: 0.1}]\n",
        ":5:1: segments: curvature jumps",
    ),
    "no segments": (GOOD + "segments: []\n", ":5:1: segments: "),
    "endless segment": (GOOD + "segments: [{length_m: 1e9}]\n", ":5:13: segments.0.length_m: .*100000"),
    "lane too wide": (GOOD + "lane_width_m: 16\n", ":5:1: lane_width_m: .*less than"),
    "start beyond the end": (GOOD + "start: {station_m: 5e3}\n", ":5:9: start.station_m: the road runs"),
    "start beside the road": (GOOD + "start: {offset_m: 1e9}\n", ":5:9: start.offset_m: .*less than"),
    "drift without speed": (GOOD + "start: {drift_mps: 1}\n", ":5:1: start: drift_mps 1 needs"),
    # Vehicle and faults.
    "unknown estimator": (GOOD + "estimators: [lidar]\n", ":5:14: estimators.0: no estimator 'lidar'"),
    "estimator twice": (GOOD + "estimators: [cv, cv]\n", ":5:18: estimators.1: 'cv' is named twice"),
    "unknown fault": (
        GOOD + "faults: [{kind: gremlins}]\n",
        ":5:10: faults.0: .*'gremlins'.*'frozen_camera'",
    ),
    "fault without kind": (GOOD + "faults: [{from_s: 1}]\n", ":5:10: faults.0: "),
    "fault that ends before it begins": (
        GOOD + "faults: [{kind: black_frames, from_s: 5, to_s: 1}]\n",
        ":5:10: faults.0: to_s 1 must be after from_s 5",
    ),
    "misspelt field of a fault": (
        GOOD + "faults: [{kind: late_frames, from_s: 1, delay: 1}]\n",
        ":5:41: unknown field 'faults.0.delay'; did you mean 'delay_s'",
    ),
    "fault of no process": (
        GOOD + "faults: [{kind: lost_process, process: radio, from_s: 1}]\n",
        "bad.yaml:.*no process 'radio'; there are",
    ),
    "unknown disturbance": (
        GOOD + "disturbances: [{kind: nite, grade: 1}]\n",
        ":5:17: disturbances.0.kind: ",
    ),
    "grade too high": (GOOD + "disturbances: [{kind: night, grade: 9}]\n", ":5:30: disturbances.0.grade: "),
    "vehicle without a place": (GOOD + "traffic: [{speed_mps: 3}]\n", ":5:11: traffic.0: give one of gap_m"),
    "manoeuvre without a trigger": (
        GOOD + "traffic: [{gap_m: 9, phases: [{kind: change_speed, to_mps: 3}]}]\n",
        ":5:31: traffic.0.phases.0: give one of at_s",
    ),
    "unknown plant": (GOOD + "plant: {model: hovercraft}\n", ":5:9: plant.model: "),
    "unknown field of the vehicle": (
        GOOD + "plant: {vehicle: {weelbase_m: 3}}\n",
        ":5:.*plant: .*weelbase_m",
    ),
    # Expectations.
    "sentence that means nothing": (
        GOOD + "expect: {conditions: ['fear is hgh']}\n",
        ":5:23: expect.conditions.0: .*column 9: no signal 'hgh'; did you mean 'high'",
    ),
    "sentence on what does not happen": (
        GOOD + "expect: {conditions: ['fear >= high within 1 s of glare']}\n",
        ":5:23: expect.conditions.0: .*nothing called 'glare' happens",
    ),
    "sentence on an estimator that does not run": (
        GOOD + "estimators: [cv]\nexpect: {conditions: ['cnn.confidence >= 0.5']}\n",
        ":6:23: expect.conditions.0: .*column 1: no estimator 'cnn' runs here; there are cv",
    ),
    "sentence on an unknown mode": (
        GOOD + "expect: {conditions: ['mode is STOPP']}\n",
        ":5:23: expect.conditions.0: .*column 9: mode has no 'STOPP'.*did you mean 'STOP'",
    ),
    "sentence on an unknown cause": (
        GOOD + "expect: {conditions: ['never cause is unconfimed']}\n",
        ":5:23: expect.conditions.0: .*column 16: no cause 'unconfimed'; did you mean 'unconfirmed'",
    ),
    "sentence on an unknown path source": (
        GOOD + "expect: {conditions: ['path_source is memry']}\n",
        ":5:23: expect.conditions.0: .*column 16: no path_source 'memry'; did you mean 'memory'",
    ),
    "sentence on a section that the road lacks": (
        GOOD + "expect: {conditions: ['section is wrn']}\n",
        ":5:23: expect.conditions.0: .*column 12: no section 'wrn'",
    ),
    # Ranges.
    "mistake beside ranges": (
        GOOD + "expect: {conditions: ['never cause is unconfimed']}\nvary: {start.offset_m: [0, 1]}\n",
        ":5:23: expect.conditions.0: .*no cause 'unconfimed'",
    ),
    "varied field that is not there": (
        GOOD + "vary: {start.ofset_m: [0, 1]}\n",
        ":5:8: vary: unknown field 'start.ofset_m'; did you mean 'offset_m'",
    ),
    "end of a range that is refused": (
        GOOD + "vary: {lane_width_m: [0.05, 3]}\n",
        r":5:8: vary: lane_width_m: .*greater than or equal to 0.1 \(for 0.05\)",
    ),
    "range from high to low": (GOOD + "vary: {lane_width_m: [3, 2.5]}\n", ":5:8: vary.lane_width_m: from 3"),
    "range of three": (
        GOOD + "vary: {lane_width_m: [2, 3, 4]}\n",
        ":5:8: vary.lane_width_m: expected a range",
    ),
    "logarithm of zero": (
        GOOD + "vary: {start.offset_m: {from: 0, to: 1, log: true}}\n",
        ":5:8: vary.start.offset_m: from 0 must be positive",
    ),
    "varied item that is not there": (GOOD + "vary: {tags.3: [0, 1]}\n", ":5:8: vary: tags.3: no item '3'"),
    "no choice": (GOOD + "vary: {road: {choices: []}}\n", ":5:15: vary.road.choices: "),
    "choice of a road that is not there": (
        GOOD + "vary: {road: {choices: [straight, strait]}}\n",
        r":5:8: vary: road: no road 'strait'; .*\(for 'strait'\)",
    ),
}


def command_line(monkeypatch, capsys, *arguments):
    """Exit code, output and errors of the command line."""
    monkeypatch.setattr(sys, "argv", ["trepid", *map(str, arguments)])
    code = trepid.cli.main()
    return code, *capsys.readouterr()


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_one_line_and_exit_code_2(kind, tmp_path, monkeypatch, capsys):
    content, message = BAD[kind]
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bad.yaml"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    code, out, err = command_line(monkeypatch, capsys, "sim", "run", "bad.yaml", "--json")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("trepid: ")
    with pytest.raises(InputError, match=message):
        load_scenario("bad.yaml")


def test_a_mistake_on_the_command_line_is_named_there_in_a_scenario_with_ranges(tmp_path):
    (tmp_path / "ranges.yaml").write_text(GOOD + "vary: {start.offset_m: [0, 1]}\n")
    with pytest.raises(InputError, match=r"^--set estimators: estimators\.0: no estimator 'rule_tuu'"):
        load_scenario(str(tmp_path / "ranges.yaml"), {"estimators": "[rule_tuu,cv]"})


def test_a_folder_instead_of_a_file_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / "bad.yaml").mkdir()
    code, _, err = command_line(monkeypatch, capsys, "sim", "run", tmp_path / "bad.yaml")
    assert (code, err.count("\n")) == (2, 1)


def test_more_than_thirty_kinds_are_named_with_line_and_column():
    assert sum(message.startswith(":") for _, message in BAD.values()) >= 30


# Mutations of the shipped files.

TEXTS = [path.read_text(encoding="utf-8") for path in sorted((CONFIG_DIR / "scenarios").glob("*.yaml"))]
# fmt: off
ODD = [None, True, -1, 0, 0.5, 7, 1e308, -1e308, 5e-324, 10**30, "", "x", "🚗", "\u202e", "~", [], {}, [[]],
       {"a": 1}]
SNIPPETS = ["\t", '"', "'", "*x", "&x ", "<<: ", "{", "]", ": ", "- ", "#", "\x00", "\ud7ff", "ü", "!!set ",
            "1e999", "\n", "? "]
# fmt: on
share = st.floats(0, 1, exclude_max=True)


def places(node, way=()):
    """The way to every value below ``node``."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*way, key)
        yield from places(value, (*way, key))


def mutate(data, change, place, value):
    """``data`` with one value deleted, replaced, doubled, renamed or moved."""
    ways = list(places(data))
    way = ways[int(place * len(ways))]
    for key in way[:-1]:
        data = data[key]
    key = way[-1]
    if change == "delete":
        del data[key]
    elif change == "replace":
        data[key] = copy.deepcopy(value)
    elif change == "double" and isinstance(data, list):
        data.insert(key, copy.deepcopy(data[key]))
    elif change == "rename" and isinstance(data, dict):
        data[f"{key}_"] = data.pop(key)
    elif change == "wrap":
        data[key] = [data[key]]
    elif isinstance(data[key], int | float):
        data[key] = data[key] * (1e12 if change == "inflate" else -1)


def loads_or_is_told(path):
    """The scenario, or None after one line with the error."""
    try:
        return load_scenario(str(path))
    except InputError as error:
        assert "\n" not in str(error)
        assert path.name in str(error) or "config" in str(error)
        return None


def starts(scenario):
    """The scenario runs its first moments, without pictures."""
    data = scenario.shorten(0.1).model_dump(mode="json", exclude_unset=True)
    kept = [f for f in data.get("faults", []) if f["kind"] not in ("frozen_camera", "black_frames")]
    run(Scenario.model_validate({**data, "sight": "truth", "disturbances": [], "faults": kept, "vary": {}}))


@given(
    st.sampled_from(TEXTS),
    st.lists(
        st.tuples(
            st.sampled_from(["delete", "replace", "double", "rename", "wrap", "inflate", "negate"]),
            share,
            st.sampled_from(ODD),
        ),
        min_size=1,
        max_size=3,
    ),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_scenario_with_changed_values_is_refused_in_one_line_or_starts(tmp_path, text, changes):
    data = YAML(typ="safe").load(text)
    for change in changes:
        mutate(data, *change)
    buffer = io.StringIO()
    YAML(typ="safe").dump(data, buffer)
    path = tmp_path / "mutated.yaml"
    path.write_text(buffer.getvalue(), encoding="utf-8")
    scenario = loads_or_is_told(path)
    if scenario is not None:
        starts(scenario)


@given(st.sampled_from(TEXTS), st.lists(st.tuples(share, st.sampled_from(SNIPPETS)), min_size=1, max_size=4))
@example(GOOD, [(0.0, "\ufeff")])
@example(GOOD, [(0.5, "\u2028")])
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_scenario_with_strange_characters_is_refused_in_one_line_or_loads(tmp_path, text, insertions):
    for place, snippet in insertions:
        at = int(place * len(text))
        text = text[:at] + snippet + text[at:]
    path = tmp_path / "mutated.yaml"
    path.write_text(text, encoding="utf-8")
    loads_or_is_told(path)


@given(st.sampled_from(TEXTS), share, share, st.sampled_from(["cut", "drop", "double", "indent", "swap"]))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_scenario_with_muddled_lines_is_refused_in_one_line_or_loads(tmp_path, text, first, second, change):
    lines = text.splitlines(keepends=True)
    i, j = int(first * len(lines)), int(second * len(lines))
    if change == "cut":
        lines = lines[:i]
    elif change == "drop":
        del lines[i]
    elif change == "double":
        lines.insert(j, lines[i])
    elif change == "indent":
        lines[i] = "   " + lines[i]
    else:
        lines[i], lines[j] = lines[j], lines[i]
    path = tmp_path / "mutated.yaml"
    path.write_text("".join(lines), encoding="utf-8")
    loads_or_is_told(path)


@given(st.binary(max_size=200))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_refused_in_one_line(tmp_path, content):
    path = tmp_path / "mutated.yaml"
    path.write_bytes(content)
    assert loads_or_is_told(path) is None
