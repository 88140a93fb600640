"""The report page in a real browser: it opens alone, sorts, filters, and shows a run."""

import json
import re

import numpy as np
import pytest
from browser_rig import chromium
from process_rig import until

from sim_harness.judging.metrics import MEANINGS
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import run
from sim_harness.report.film import Film, run_filmed
from sim_harness.report.page import MAX_FILMS, MAX_OTHER_PICTURES, Page
from sim_harness.report.summary import code_differences, kept_samples, summarise, worst_sample
from sim_harness.scenarios.scenario import load_scenario

LONG = pytest.mark.long  # a browser, or a second drive


def decode(code):
    """As the page does it."""
    last, values = 0, []
    for difference in code["d"]:
        if difference is not None:
            last += difference
        values.append(np.nan if difference is None else last * code["step"])
    return np.array(values)


@pytest.fixture(scope="module")
def scenario():
    road = {"segments": "[{length_m: 100}]", "distance_m": "80"}  # less to paint than a kilometre
    return load_scenario("straight", {"start.speed_mps": "6", **road}).shorten(3.0)


@pytest.fixture(scope="module")
def filmed_run(scenario):
    return run_filmed(scenario, seed=5)


@pytest.fixture(scope="module")
def detail(scenario, filmed_run):
    return summarise(scenario, *filmed_run)


def toy(**columns):
    n = len(next(iter(columns.values())))
    values = {"t_s": 0.5 * np.arange(n), "departures": np.zeros(n), "lateral_offset_m": np.zeros(n)}
    values |= {"decision.fear": np.zeros(n), "speed_mps": np.ones(n)}
    return Trace(
        {**values, **{name.replace("__", "."): np.asarray(v, float) for name, v in columns.items()}}, {}
    )


def test_filming_changes_nothing(scenario, filmed_run):
    assert run(scenario, seed=5).trace.sha256 == filmed_run[0].trace.sha256


def test_numbers_survive_their_coding_to_half_a_step():
    values = np.array([np.nan, 3.14159, -2.0, np.nan, np.nan, 5e-4, np.inf])
    assert decode(code_differences(values, 0.01)) == pytest.approx(
        [np.nan, 3.14159, -2, np.nan, np.nan, 0, np.nan], abs=0.005, nan_ok=True
    )


def test_the_kept_samples_hold_every_extreme():
    fear = np.zeros(50_000)
    fear[12_345] = 0.9
    error = 0.1 * np.sin(np.arange(50_000) / 500)
    kept = kept_samples(toy(decision__fear=fear, lateral_offset_m=error))
    assert 12_345 in kept and np.argmax(error) in kept and np.argmin(error) in kept
    assert {0, 49_999} <= set(kept) and len(kept) <= 300


def test_the_worst_moment_is_the_departure_else_fear_else_error():
    fear, error = np.array([1.0, 0.0, 0.2, 0.8, 0.6, 0.0]), np.array([0.0, 0.1, -0.5, 0.2, 0.0, 0.0])
    left = np.array([0, 0, 1, 1, 1, 1])
    assert worst_sample(toy(decision__fear=fear, lateral_offset_m=error, departures=left))[0] == 1
    assert (
        worst_sample(toy(decision__fear=fear, lateral_offset_m=error))[0] == 3
    )  # not that of the first second
    assert worst_sample(toy(decision__fear=0.1 * fear, lateral_offset_m=error))[0] == 2


def test_a_summary_is_small_and_describes_the_run(filmed_run, detail):
    trace = filmed_run[0].trace
    assert len(json.dumps({**detail, "picture": None, "frames": None})) < 30_000
    series = {name: decode(code) for name, code in detail["series"].items()}
    assert len({len(values) for values in series.values()}) == 1
    assert series["t"][-1] == pytest.approx(3.0, abs=0.01)
    assert series["x"][-1] == pytest.approx(trace["x_m"][-1], abs=0.03)
    assert series["fear"].max() == pytest.approx(np.nanmax(trace["decision.fear"]), abs=1e-3)
    assert detail["bands"]["section"] == [[0.0, trace.words["section"][0]]]
    left = np.column_stack([decode(code) for code in detail["edges"][:2]])
    right = np.column_stack([decode(code) for code in detail["edges"][2:]])
    assert np.linalg.norm(left - right, axis=1) == pytest.approx(trace["lane_width_m"][0], abs=0.08)


def test_the_picture_is_the_frame_of_that_moment(filmed_run, detail):
    result, film = filmed_run
    at_s = result.trace["t_s"][worst_sample(result.trace)[0]]
    assert at_s - 0.2 <= detail["picture"]["t"] <= at_s
    assert detail["picture"]["uri"].startswith("data:image/jpeg;base64,")
    assert film.at(-99.0) is None and Film().at(3.0) is None


@pytest.fixture(scope="module")
def page_file(scenario, filmed_run, detail, tmp_path_factory):
    """Forty runs of which every third failed, one with a name that tries to break out of the page."""
    page, row = Page("Forty runs & <some> %RUNS%"), filmed_run[0].row()
    for seed in range(40):
        failed = seed % 3 == 0
        scores = dict.fromkeys(row) if seed == 9 else row  # one crashed: it has no scores
        page.add(
            {
                **scores,
                "seed": seed,
                "scenario": "</script><b>odd" if seed == 7 else row["scenario"],
                "status": "failed" if failed else "passed",
                "reasons": ["max_lateral_error_m 0.9: at most 0.3 expected"] if failed else [],
                "max_lateral_error_m": None if seed == 9 else (seed * 7 % 40) / 100,
                "min_time_gap_s": None if seed % 2 else seed / 10,
            },
            tags=[*scenario.tags, "fault"] if seed < 4 else scenario.tags,
            detail=None if seed == 9 else detail,
        )
    path = tmp_path_factory.mktemp("report") / "report.html"
    page.write(path)
    return path


def test_the_page_is_a_single_file_without_references_to_others(page_file, detail):
    text = page_file.read_text()
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)|\ssrc=|<link|@import|url\(", text)
    assert "default-src 'none'" in text
    worst = 13 + MAX_OTHER_PICTURES  # of 14 failed runs one has no detail
    assert text.count("data:image/jpeg") == worst + MAX_FILMS * len(detail["frames"])


def test_lane_edges_that_runs_share_are_stored_once(page_file):
    text = page_file.read_text()
    edges = re.search(r'id="edges">(.*?)</script>', text, re.DOTALL)
    assert len(json.loads(edges[1])) == 1


@pytest.fixture(scope="module")
def browser(page_file, tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile"), "--window-size=1366,900") as driver:
        driver.get(page_file.as_uri())
        yield driver


def column(browser, name):
    script = """const heads = [...document.querySelectorAll('#heads th')];
                const at = heads.findIndex(head => head.dataset.name === arguments[0]);
                return [...document.querySelectorAll('#rows tr.run')].map(row => row.cells[at].textContent);"""
    return browser.execute_script(script, name)


def click(browser, selector):
    browser.find_element("css selector", selector).click()


@LONG
def test_the_page_requests_nothing_from_the_network_and_reports_no_error(browser, page_file):
    assert [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")] == []
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    requested = {m["request"]["url"] for m in sent if m["documentURL"] == page_file.as_uri()}
    assert requested == {page_file.as_uri()}


@LONG
def test_every_run_has_a_row_and_odd_names_are_only_text(browser):
    assert len(column(browser, "seed")) == 40
    assert column(browser, "scenario")[7] == "</script><b>odd"
    assert browser.find_elements("css selector", "#rows b") == []
    assert "40 runs, 14 not passed" in browser.find_element("id", "about").text
    assert browser.find_element("id", "title").text == "Forty runs & <some> %RUNS%"


@LONG
def test_a_click_on_a_head_sorts_from_the_worst_and_another_turns_it(browser):
    click(browser, "th[data-name=max_lateral_error_m]")
    *falling, last = column(browser, "max_lateral_error_m")
    assert falling == sorted(falling, key=float, reverse=True) and len(set(falling)) == 39
    click(browser, "th[data-name=max_lateral_error_m]")
    assert column(browser, "max_lateral_error_m") == [*falling[::-1], last]
    assert last == "–"
    for _ in range(2):  # absent values come last in both orders
        click(browser, "th[data-name=min_time_gap_s]")
        assert column(browser, "min_time_gap_s")[-20:] == ["–"] * 20


@LONG
def test_runs_are_filtered_by_status_tag_and_words(browser):
    buttons = {button.text: button for button in browser.find_elements("css selector", "#tools button")}
    buttons["failed 14"].click()
    assert set(column(browser, "status")) == {"failed"} and len(column(browser, "status")) == 14
    click(browser, "#tools button[aria-pressed=true]")
    search = browser.find_element("css selector", "#tools input")
    search.send_keys("odd 7")
    assert column(browser, "seed") == ["7"]
    search.clear()
    search.send_keys(" ")
    next(b for b in browser.find_elements("css selector", "#tools button") if b.text == "fault").click()
    assert sorted(column(browser, "seed")) == ["0", "1", "2", "3"]
    click(browser, "#tools button[aria-pressed=true]")
    assert len(column(browser, "seed")) == 40


@LONG
def test_a_click_on_a_run_opens_its_path_timelines_picture_reasons_and_command(browser):
    assert browser.find_elements("css selector", ".sheet") == []
    click(browser, "#run-3")
    sheet = browser.find_element("css selector", "#sheet-3 .sheet")
    assert "max_lateral_error_m 0.9: at most 0.3 expected" in sheet.text
    assert sheet.find_element("css selector", "code").text == "trepid sim run straight --seed 3"
    assert len(sheet.find_elements("css selector", "svg.map path.edge")) == 2
    assert len(sheet.find_elements("css selector", "svg.map path.path")) > 5
    assert len(sheet.find_elements("css selector", "svg.lines path.plot")) == 3
    width = browser.execute_script(
        "return arguments[0].naturalWidth", sheet.find_element("css selector", "img")
    )
    assert width == 480
    names = [dt.text for dt in sheet.find_elements("css selector", "dt")]
    assert {"trace_sha256", "fear_auroc", "modes"} <= set(names)
    values = {cell.text for cell in sheet.find_elements("css selector", "dd")}
    assert "false" not in " ".join(values) and any(value.endswith(" m/s²") for value in values)


@LONG
def test_the_cursor_reads_the_run_at_its_time(browser, detail):
    series = {name: decode(code) for name, code in detail["series"].items()}
    browser.execute_script(
        """const lines = document.querySelector('#sheet-3 svg.lines'), box = lines.getBoundingClientRect();
           lines.dispatchEvent(new PointerEvent('pointermove', {clientX: box.right - 8, clientY: box.top + 20}));"""
    )
    readout = browser.find_element("css selector", "#sheet-3 .readout").text
    assert f"t {series['t'][-1]:.2f} s" in readout and f"speed {series['speed'][-1]:.2f} m/s" in readout
    dot = browser.find_element("css selector", "#sheet-3 svg.map circle")
    assert float(dot.get_attribute("cx")) == pytest.approx(series["x"][-1], abs=0.01)


@LONG
def test_a_run_without_timelines_shows_a_note_and_a_second_click_closes_it(browser):
    click(browser, "#run-9")
    assert "This run has no stored timelines" in browser.find_element("css selector", "#sheet-9").text
    click(browser, "#run-9")
    assert browser.find_elements("css selector", "#sheet-9") == []
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.fixture(scope="module")
def overtaken():
    """A run with another vehicle ahead, and what its report shows of it."""
    scenario = load_scenario("cut_in", {}).shorten(6.0)
    result, film = run_filmed(scenario, seed=2)
    return result, film, summarise(scenario, result, film)


@LONG
def test_the_other_vehicles_and_the_rules_are_those_of_their_time(overtaken):
    result, film, detail = overtaken
    trace, found = result.trace, detail["glimpses"]
    times, (x_m, y_m) = decode(found["t"]), [decode(code) for code in found["others"][0][:2]]
    assert len(found["others"]) == 1 and len(times) == len(x_m) == len(found["fired"]) > 25
    for t_s, x, y in zip(times, x_m, y_m, strict=True):
        at = int(np.argmin(np.abs(trace["t_s"] - trace["t_s"][0] - t_s)))
        if np.isfinite(trace["lead_gap_m"][at]):
            assert np.hypot(trace["lead_x_m"][at] - x, trace["lead_y_m"][at] - y) < 3.5  # another point of it
    driven = [one for one in film.glimpses if one.t_s >= trace["t_s"][0] - 1e-6]
    for one, fired in zip(driven, found["fired"], strict=True):
        shown = [(found["texts"][number], percent) for number, percent in fired]
        assert shown[:1] == [(text, round(100 * strength)) for text, strength in one.rules[:1]]
    assert any("lead" in text or "gap" in text for text in found["texts"])


@LONG
def test_a_run_shorter_than_the_interval_of_its_film_is_summarised(overtaken):
    detail = summarise(load_scenario("cut_in", {}), overtaken[0], Film())
    assert detail["glimpses"]["others"] == detail["glimpses"]["fired"] == []
    assert detail["frames"] is None and detail["picture"] is None


@LONG
def test_every_figure_of_a_run_has_a_meaning(overtaken):
    assert set(overtaken[0].row()) - {"scenario", "seed", "reasons"} <= set(MEANINGS)


@LONG
def test_the_cursor_shows_the_frame_the_vehicles_and_the_rules_of_its_time(
    browser, overtaken, tmp_path_factory
):
    result, _, detail = overtaken
    page, path = Page("one"), tmp_path_factory.mktemp("one") / "one.html"
    page.add(result.row(), detail=detail)
    page.write(path)
    browser.get(path.as_uri())
    click(browser, "#run-0")
    assert until(lambda: browser.find_elements("css selector", "#sheet-0 svg.lines"), patience_s=15.0)

    def at(share):
        browser.execute_script(
            """const lines = document.querySelector('#sheet-0 svg.lines'), box = lines.getBoundingClientRect();
               const x = box.left + 46 + arguments[0] * (box.width - 54);
               lines.dispatchEvent(new PointerEvent('pointermove', {clientX: x, clientY: box.top + 20}));""",
            share,
        )
        film = browser.find_element("css selector", "#sheet-0 .film")
        other = browser.find_element("css selector", "#sheet-0 rect.other")
        fired = browser.find_element("css selector", "#sheet-0 .fired").text
        image = film.find_element("css selector", "img")
        shown = browser.execute_script("return arguments[0].naturalWidth", image)
        return image.get_attribute("src"), other.get_attribute("transform"), fired, film.text, shown

    early, late = at(0.3), at(1.0)
    assert early[0] != late[0] and early[1] != late[1] and early[4] == late[4] == 320
    times = [t for t, _ in detail["frames"]]
    assert late[3] == f"Frame at the cursor: {times[-1]:.1f} s."
    number, percent = next(fired[0] for fired in reversed(detail["glimpses"]["fired"]) if fired)
    assert f"{percent / 100:.2f}" in late[2] and detail["glimpses"]["texts"][number] in late[2]
    click(browser, "details.more summary")
    meanings = browser.find_element("id", "meanings").text
    assert "greatest deceleration [m/s²]." in meanings
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
