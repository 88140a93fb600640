"""The live page in a real browser: it shows what is published, survives restarts, stops, and serves everybody."""

import base64
import json
import math
import os
import signal
import time
from pathlib import Path
from typing import Any

import cv2
import pytest
from browser_rig import chromium
from live_page_rig import RING, STATIC, LivePage, Publisher, Scene, rule_copy
from message_rig import decision
from process_rig import until

from sim_harness.lockstep.closed_loop import Instant, run
from sim_harness.scenarios.scenario import load_scenario
from trepid.causes import NO_COMMAND
from trepid.config import ROOT
from trepid.images.jpeg import encode_jpeg
from trepid.messages import Limit, Mode, Stop
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording
from trepid.topics import DECISION
from trepid.wire import to_cdr
from vehicle.driver.stop_button import STOPPED

pytest.importorskip("selenium")
pytestmark = pytest.mark.long
PATIENCE_S = 15.0
END_WORDS = "its 30 s are over; passed"


class Seen:
    """A page process with its bus and a browser that looks at it."""

    def __init__(self, page: LivePage, publisher: Publisher, browser: Any) -> None:
        self.page, self.publisher, self.browser = page, publisher, browser
        self.scene = publisher.scene

    def text(self, name: str) -> str:
        """Text of the element with this id."""
        return str(
            self.browser.execute_script("return document.getElementById(arguments[0])?.textContent", name)
        )

    def becomes(self, name: str, text: str) -> bool:
        """True when the element shows ``text`` soon."""
        return until(lambda: self.text(name) == text, patience_s=PATIENCE_S) or pytest.fail(
            f"{name} shows {self.text(name)!r}, expected {text!r}"
        )

    def js(self, script: str, *arguments: object) -> Any:
        """The result of a script."""
        return self.browser.execute_script(script, *arguments)

    def pixel(self, x: float, y: float) -> list[int]:
        """Red, green and blue of the camera picture at a share of its width and height."""
        script = """const canvas = document.getElementById('camera');
                    const [x, y] = [canvas.width * arguments[0], canvas.height * arguments[1]];
                    return [...canvas.getContext('2d').getImageData(x, y, 1, 1).data].slice(0, 3)"""
        return list(self.js(script, x, y))

    def has_sets(self) -> bool:
        """True when the rules tab shows the sets of the inputs soon."""
        sets = "return document.querySelectorAll('#sets figure').length"
        return until(lambda: self.js(sets) > 5, patience_s=PATIENCE_S)

    def click(self, name: str) -> None:
        """Click on the element with this id."""
        self.browser.find_element("id", name).click()


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XDG_RUNTIME_DIR", str(folder))
        environment.setenv("XDG_STATE_HOME", str(folder / "state"))
        with (
            chromium(folder / "profile") as browser,
            LivePage(rule_copy(folder)) as page,
            page.bus() as bus,
            Publisher(bus, page.clock, Scene()) as publisher,
        ):
            page.start()
            browser.get(page.door.url)
            yield Seen(page, publisher, browser)


@pytest.fixture(autouse=True)
def at_ease(seen):
    """Each test begins with the undisturbed scene on the first tab."""
    fresh = Scene()
    seen.scene.__dict__.update(fresh.__dict__)
    seen.publisher.button.held = False
    seen.js("document.getElementById('tab-drive').click()")
    seen.becomes("mode", "KEEP")


def test_the_page_shows_what_is_published(seen):
    assert seen.becomes("speed", "7.1") and seen.becomes("cap", "5.0")
    assert seen.becomes("fear", "0.12") and seen.text("level") == "low"
    assert seen.becomes("source", "cv+cnn") and seen.becomes("legend-cv", "0.91")
    assert seen.becomes("legend-cnn", "0.42") and seen.becomes("legend-lead", "23.4 m")
    rules = seen.js("return [...document.querySelectorAll('#firing li')].map(li => li.textContent)")
    assert rules == [
        "0.75if lane confidence is low then fear is high",
        "0.25if speed is high then fear is low",
    ]
    assert seen.becomes("now-error", "0.07") and seen.becomes("now-latency", "22.0")
    assert until(lambda: float(seen.text("driven")) > 1.0, patience_s=PATIENCE_S)
    table = seen.js(
        "return [...document.querySelectorAll('tbody tr')].map(tr => [...tr.children].map(c => c.textContent))"
    )
    vehicle, cnn = table
    assert [vehicle[0], vehicle[1], vehicle[3], vehicle[4]] == ["vehicle", "100.0", "12.5", "3"]
    assert cnn[-1] == "not running: was killed by SIGKILL"


@pytest.mark.parametrize(
    ("change", "word", "because"),
    [
        (dict(mode=Mode.CAUTION, cause="dark", fear=0.5), "CAUTION", "at most 5.0 m/s: dark image"),
        (dict(limited_by=Limit.LEAD, lead_m=23.4), "KEEP", "following the vehicle ahead, 23 m"),
        (dict(limited_by=Limit.CRUISE), "KEEP", "at most 5.0 m/s: cruise speed"),
        (
            dict(mode=Mode.STOP, stop=Stop.EMERGENCY, cause="lost_camera", part="camera"),
            "STOP",
            "emergency stop: lost camera (camera)",
        ),
        (
            dict(mode=Mode.CAUTION, cause="doubted_state", part="yaw rate", fear=0.5),
            "CAUTION",
            "at most 5.0 m/s: doubted measurement (yaw rate)",
        ),
        (dict(mode=Mode.FOLLOW, cause="no_path"), "FOLLOW", "following the vehicle ahead: no path"),
    ],
)
def test_the_banner_names_mode_and_cause_and_a_change_is_spoken(seen, change, word, because):
    seen.scene.decision = {**seen.scene.decision, **change}
    assert seen.becomes("mode", word) and seen.becomes("because", because)
    assert word == "KEEP" or seen.text("announce") == f"Mode {word}. {because}"
    assert seen.js("return document.title").startswith(word)


@pytest.mark.parametrize(
    ("width", "height", "mobile"), [(1280, 900, False), (390, 844, True), (844, 390, True)]
)
def test_mode_reason_fear_and_stop_stay_in_sight_however_far_the_page_is_scrolled(
    seen, width, height, mobile
):
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    seen.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    words = "stopped: late or lost estimator (cv); waits for a restart of the drive"
    seen.scene.decision = {**seen.scene.decision, "mode": Mode.STOP, "waits_for": words, "fear": 1.0}
    try:
        assert seen.becomes("because", words) and seen.becomes("fear-now", "1.00")
        seen.js("window.scrollTo(0, document.body.scrollHeight)")
        assert until(lambda: seen.js("return window.scrollY") > 200, patience_s=PATIENCE_S)
        for name in ("mode", "because", "fear-now", "fear-level", "stop"):
            box = seen.js(f"return document.getElementById('{name}').getBoundingClientRect().toJSON()")
            assert 0 <= box["top"] < box["bottom"] <= height and 0 <= box["left"] < box["right"] <= width, (
                name
            )
            middle = (box["left"] + box["right"]) / 2, (box["top"] + box["bottom"]) / 2
            on_top = """const [x, y, name] = arguments;
                        return document.getElementById(name).contains(document.elementFromPoint(x, y))"""
            assert seen.js(on_top, *middle, name), f"something covers {name}"
    finally:
        seen.js("window.scrollTo(0, 0)")
        seen.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize(("width", "mobile"), [(1280, False), (390, True)])
def test_a_message_of_eighty_letters_has_a_column_of_at_least_thirty(seen, width, mobile):
    size = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": mobile}
    seen.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    measure = """const cell = document.querySelector('#processes tbody tr:last-child td:last-child');
                 const style = getComputedStyle(cell), canvas = document.createElement('canvas').getContext('2d');
                 canvas.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
                 return [cell.clientWidth, canvas.measureText('n'.repeat(30)).width, cell.scrollWidth];"""
    try:
        assert until(lambda: seen.js("return window.innerWidth") == width, patience_s=PATIENCE_S)
        wide, needed, scrolled = seen.js(measure)
        assert wide >= needed and scrolled <= wide
    finally:
        seen.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_bend_is_known_by_the_commanded_speed_and_a_driver_comes_first(seen):
    seen.scene.target_mps = 4.1
    assert seen.becomes("because", "at most 4.1 m/s: bend")
    seen.scene.target_mps = None
    assert seen.becomes("because", "at most 5.0 m/s")


def test_a_stop_of_the_vehicle_itself_is_named_although_the_decision_would_drive(seen):
    seen.scene.own_stop = NO_COMMAND
    assert seen.becomes("mode", "STOP") and seen.becomes("because", NO_COMMAND)
    assert seen.becomes("cap", "0.0")
    seen.scene.own_stop = ""
    assert seen.becomes("mode", "KEEP")


def test_the_word_of_the_mode_is_legible_from_three_metres(seen):
    """Letters of 1/200 of the distance are legible for everybody: 15 mm, at 96 pixels per inch 57 pixels."""
    height = """const style = getComputedStyle(document.getElementById('mode'));
                const context = document.createElement('canvas').getContext('2d');
                context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
                return context.measureText('KEEP').actualBoundingBoxAscent;"""
    assert seen.js(height) >= 57


def test_the_picture_is_the_published_one_with_lines_on_it(seen):
    seen.scene.grey = 200
    assert until(lambda: abs(seen.pixel(0.1, 0.1)[0] - 200) < 6, patience_s=PATIENCE_S)
    red, green, blue = seen.pixel(95 / 320, 190 / 240)  # on the left line of cv and cnn
    assert max(red, green, blue) - min(red, green, blue) > 60
    label = "return document.getElementById('camera').ariaLabel"
    assert until(lambda: "vehicle ahead at 23 metres" in seen.js(label), patience_s=PATIENCE_S)


def test_a_value_that_is_absent_is_a_dash_and_silence_is_no_data(seen):
    seen.scene.speed_mps = None
    assert seen.becomes("speed", "–")
    seen.scene.silent = True
    assert seen.becomes("mode", "NO DATA") and seen.becomes("fear", "–") and seen.becomes("legend-cv", "none")
    assert until(lambda: "no new picture" in seen.text("old"), patience_s=PATIENCE_S)
    seen.scene.silent = False
    assert seen.becomes("mode", "KEEP")


def test_a_number_of_an_estimator_that_is_not_finite_is_a_dash_and_the_rest_is_shown(seen):
    seen.scene.confidence["cv"] = math.nan
    assert seen.becomes("legend-cv", "–") and seen.becomes("now-cv", "–") and seen.text("mode") == "KEEP"
    seen.scene.lead_m = math.inf
    assert seen.becomes("legend-lead", "none") and seen.becomes("mode", "KEEP")
    assert seen.text("connection") == "live" and seen.text("legend-cnn") == "0.42"


def test_stop_is_one_press_and_driving_on_takes_two_at_standstill(seen):
    seen.click("stop")
    assert seen.becomes("stop-word", "STOPPED") and seen.becomes("because", STOPPED)
    assert seen.publisher.button.held
    seen.click("release")
    time.sleep(0.3)
    assert seen.publisher.button.held
    seen.click("release")
    assert until(lambda: not seen.publisher.button.held, patience_s=PATIENCE_S)
    assert seen.becomes("stop-word", "STOP") and seen.becomes("mode", "KEEP")


def test_a_stop_that_the_car_does_not_confirm_raises_an_alarm_and_goes_on(seen):
    seen.scene.deaf = True
    seen.click("stop")
    assert seen.becomes("because", "stop button pressed")
    assert until(lambda: "does NOT confirm the stop" in seen.text("alarm"), patience_s=PATIENCE_S)
    assert seen.becomes("mode", "KEEP")  # what the car does
    seen.click("stop")
    time.sleep(0.5)
    assert "does NOT confirm the stop" in seen.text("alarm") and seen.text("stop-word") == "stopping"
    seen.scene.deaf = False
    assert seen.becomes("stop-word", "STOPPED") and seen.becomes("alarm", "")
    assert seen.js("return document.getElementById('alarm').hidden")


def test_a_stop_without_an_answer_is_sent_again_after_a_second(seen):
    """A request to a page process that is frozen has neither an answer nor an error."""
    os.kill(seen.page.pid, signal.SIGSTOP)
    try:
        seen.click("stop")
        assert until(lambda: "NOT delivered" in seen.text("alarm"), patience_s=PATIENCE_S)
    finally:
        os.kill(seen.page.pid, signal.SIGCONT)
    assert seen.becomes("stop-word", "STOPPED") and seen.becomes("alarm", "")


def test_everything_is_done_by_keyboard(seen):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def press(*keys: str) -> None:
        ActionChains(seen.browser).send_keys(*keys).perform()

    def focused() -> str:
        return str(seen.js("return document.activeElement.id"))

    seen.browser.refresh()
    seen.becomes("mode", "KEEP")
    press(Keys.TAB)
    assert focused() == "stop"  # the first of all
    press(Keys.TAB)
    assert focused() == "tab-drive"
    press(Keys.ARROW_RIGHT)
    assert focused() == "tab-rules" and not seen.js("return document.getElementById('rules').hidden")
    assert until(
        lambda: "inputs:" in seen.js("return document.getElementById('text').value"), patience_s=PATIENCE_S
    )
    order = []
    for _ in range(4):
        press(Keys.TAB)
        order.append(focused())
    assert order == ["text", "check", "apply", "reread"]
    press(Keys.ESCAPE)
    assert seen.becomes("stop-word", "STOPPED")


def test_rules_are_checked_at_their_line_applied_and_marked_with_the_present_values(seen):
    seen.click("tab-rules")
    assert seen.has_sets()
    assert seen.becomes("value-speed", "7.1") and seen.becomes("value-lane_confidence", "missing")
    good = seen.page.rules.read_text(encoding="utf-8")
    at = good.splitlines().index("    risk: rising") + 1
    edit = "const t = document.getElementById('text'); t.value = arguments[0]; t.dispatchEvent(new Event('input'))"
    seen.js(edit, good.replace("    risk: rising", "    risk: sideways", 1))
    seen.click("apply")
    assert until(lambda: f":{at}:" in seen.text("verdict"), patience_s=PATIENCE_S), seen.text("verdict")
    assert seen.page.rules.read_text(encoding="utf-8") == good
    row = "const t = document.getElementById('text'); return t.value.slice(0, t.selectionStart).split('\\n').length"
    assert seen.js(row) == at
    changed = good.replace("# The fear rules.", "# Rules of a test.")
    seen.js(edit, changed)
    seen.click("apply")
    assert until(lambda: "applied" in seen.text("edited"), patience_s=PATIENCE_S), seen.text("verdict")
    assert seen.page.rules.read_text(encoding="utf-8") == changed
    assert not list(seen.page.rules.parent.glob(".fear.yaml.*"))


def test_the_page_survives_the_restart_of_its_server_and_of_the_drive(seen):
    os.kill(seen.page.pid, signal.SIGKILL)
    seen.page.stop()
    assert seen.becomes("mode", "NO DATA")
    assert until(lambda: "connection" in seen.text("connection"), patience_s=PATIENCE_S)
    seen.page.start()
    assert seen.becomes("connection", "live") and seen.becomes("mode", "KEEP")


def test_the_page_survives_the_restart_of_the_whole_drive_and_says_so(seen):
    """Another launcher, bus and clock; the address stays, because port and token do."""
    seen.page.stop()
    assert seen.becomes("mode", "ENDED")
    try:
        with (
            LivePage(seen.page.rules, seen.page.door, what="another drive") as page,
            page.bus() as bus,
            Publisher(bus, page.clock, Scene()) as publisher,
        ):
            publisher.scene.decision["mode"] = Mode.CAUTION
            page.start()
            assert seen.becomes("mode", "CAUTION") and seen.becomes("what", "another drive")
            assert seen.text("notice").startswith("New drive: another drive, since ")
            assert not seen.js("return document.getElementById('notice').hidden")
            assert until(lambda: float(seen.text("driven")) > 0.0, patience_s=PATIENCE_S)
    finally:
        seen.page.start()
    assert seen.becomes("mode", "KEEP") and seen.becomes("what", "a test")
    assert seen.text("notice").startswith("New drive: a test, since ")


def test_after_a_lost_connection_the_page_says_that_it_is_connected_again(seen):
    os.kill(seen.page.pid, signal.SIGKILL)
    seen.page.stop()
    assert seen.becomes("mode", "NO DATA")
    seen.page.start()
    assert seen.becomes("mode", "KEEP")
    assert seen.text("notice").startswith("Connected again at ")


def test_a_drive_that_ends_says_why_until_the_next_one_begins_and_has_no_car_to_stop(seen):
    seen.scene.end = END_WORDS
    assert until(lambda: seen.text("legend-lead") not in ("", "–"), patience_s=PATIENCE_S)
    time.sleep(0.6)  # the next report of the launcher
    seen.page.stop()
    assert seen.becomes("mode", "ENDED") and seen.becomes("connection", "drive ended")
    assert seen.text("because").startswith("drive ended at ")
    assert END_WORDS in seen.text("because")
    assert {seen.text(f"legend-{name}") for name in ("cv", "cnn", "lead")} == {"–"}
    assert seen.text("source") == "–" and not seen.text("firing")
    assert seen.js("return document.getElementById('stop').disabled")
    time.sleep(3.0)  # the page tries to connect again meanwhile
    assert seen.text("mode") == "ENDED" and seen.text("fear-now") == "–"
    seen.page.start()
    assert seen.becomes("mode", "KEEP")


def test_a_page_that_fails_to_draw_says_so_and_still_receives(seen):
    seen.js("document.getElementById('what').id = 'gone'")
    assert until(lambda: "reload it" in seen.text("connection"), patience_s=PATIENCE_S)
    assert seen.becomes("mode", "NO DATA")
    messages = seen.js("return trepid.messages")
    assert until(lambda: seen.js("return trepid.messages") > messages + 3, patience_s=PATIENCE_S)
    seen.browser.get_log("browser")  # its errors are meant
    seen.browser.refresh()
    assert seen.becomes("mode", "KEEP")


def test_one_press_keeps_the_last_minutes(seen):
    seen.click("keep")
    assert until(lambda: "holds nothing to keep yet" in seen.text("kept"), patience_s=PATIENCE_S)
    assert seen.text("kept").startswith("not kept: ")
    ring = Path(os.environ["XDG_STATE_HOME"]) / "trepid" / "ring" / RING
    ring.mkdir(parents=True)
    for number in (1, 2):
        with Recording(ring / f"{number}.mcap", {"fear.yaml": b"rules"}, {"what": "test"}) as part:
            for at_s in (10.0 * number, 10.0 * number + 1):
                decided = to_cdr(decision(at_s))
                part.add(DECISION.key, decided, at_s=at_s)
    seen.click("keep")
    assert until(lambda: seen.text("kept").startswith("kept: "), patience_s=PATIENCE_S), seen.text("kept")
    path = Path(seen.text("kept").removeprefix("kept: "))
    assert path.parent.name == "kept" and path.stem.endswith("-page")
    assert [at_s for at_s, _ in read_recording(path, DECISION.key).of(DECISION)] == [10, 11, 20, 21]


def test_the_reason_why_nothing_is_kept_goes_with_its_drive(seen):
    script = """return import('/static/keep.js').then(({ KeepButton }) => {
        const [keep, kept] = ['keep', 'kept'].map(id => document.getElementById(id));
        const button = new KeepButton();
        return ['recorded in a.mcap', ''].map(why => {
            button.show({ no_keep: why });
            return [keep.hidden, kept.textContent];
        });
    });"""
    try:
        assert seen.js(script) == [[True, "recorded in a.mcap"], [False, ""]]
    finally:
        seen.browser.get(seen.page.door.url)


def test_two_viewers_see_the_same_and_a_hidden_one_costs_the_other_nothing(seen):
    first = seen.browser.current_window_handle
    seen.browser.switch_to.new_window("window")
    seen.browser.get(seen.page.door.url)
    assert seen.becomes("mode", "KEEP")
    seen.scene.decision = {**seen.scene.decision, "mode": Mode.CAUTION, "fear": 0.55}
    assert seen.becomes("mode", "CAUTION") and seen.becomes("fear", "0.55")
    seen.browser.close()
    seen.browser.switch_to.window(first)
    assert seen.becomes("mode", "CAUTION") and seen.becomes("fear", "0.55")


def test_a_wrong_token_shows_nothing_and_says_what_to_open(seen):
    good = seen.page.door.url.partition("#")[2]
    seen.browser.get("about:blank")
    seen.browser.get(seen.page.door.url.replace(good, "wrong"))
    try:
        assert until(lambda: "wrong token" in seen.text("because"), patience_s=PATIENCE_S)
        assert seen.text("fear") == "–" and seen.js("return trepid.messages") == 0
    finally:
        seen.browser.get("about:blank")
        seen.browser.get(seen.page.door.url)
    assert seen.becomes("mode", "KEEP")
    assert "#" not in seen.browser.current_url  # others see the address bar
    seen.browser.refresh()
    assert seen.becomes("mode", "KEEP")


def test_a_phone_shows_all_without_scrolling_sideways(seen):
    size = {"width": 360, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    seen.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        for mode in Mode:
            seen.scene.decision = {**seen.scene.decision, "mode": mode}
            assert seen.becomes("mode", str(mode))
            width = "return document.documentElement.scrollWidth"  # the charts are drawn anew first
            assert until(lambda width=width: seen.js(width) <= 360, patience_s=PATIENCE_S)
            word, button = (
                seen.js(f"return document.getElementById('{name}').getBoundingClientRect().toJSON()")
                for name in ("mode", "stop")
            )
            assert word["right"] <= 360 and button["bottom"] <= 740 and button["height"] >= 48
    finally:
        seen.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("tab", ["drive", "rules"])
def test_axe_finds_no_fault_for_people_with_a_screen_reader(seen, scheme, tab):
    axe = Path(pytest.importorskip("axe_core_python").__file__).parent / "axe.min.js"
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    seen.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    try:
        seen.js(f"document.getElementById('tab-{tab}').click()")
        seen.becomes("mode", "KEEP")
        assert tab == "drive" or seen.has_sets()
        # By the protocol of the developer tools: the page's own policy forbids foreign scripts.
        seen.browser.execute_cdp_cmd("Runtime.evaluate", {"expression": axe.read_text(encoding="utf-8")})
        found = seen.browser.execute_async_script("axe.run().then(arguments[0])")
        assert [
            (fault["id"], node["target"], node["failureSummary"])
            for fault in found["violations"]
            for node in fault["nodes"]
        ] == []
    finally:
        seen.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_motion_is_reduced_where_the_system_asks_for_it(seen):
    moves = "return getComputedStyle(document.getElementById('arc')).transitionDuration"
    assert seen.js(moves) != "0s"
    media = {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    seen.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    assert seen.js(moves) == "0s"
    seen.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_no_request_leaves_the_machine_and_the_console_has_no_error(seen):
    seen.browser.get_log("browser")  # that of the restarts and wrong tokens before
    seen.browser.get_log("performance")
    seen.browser.refresh()
    assert seen.becomes("mode", "KEEP")
    messages = [json.loads(entry["message"])["message"] for entry in seen.browser.get_log("performance")]
    requested = [
        m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"
    ]
    origin = seen.page.door.url.partition("#")[0]
    assert requested and all(url.startswith(origin) for url in requested)
    assert [
        entry for entry in seen.browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")
    ] == []


def test_the_picture_of_the_page_in_the_docs_is_that_of_a_drive(seen, tmp_path):
    """``TREPID_SCREENSHOT=1`` writes docs/page.jpg again; else its size and freshness of layout are checked."""
    last = driven()
    seen.scene.picture = encode_jpeg(last.frame).jpeg
    seen.scene.estimates = dict(last.estimates)
    seen.scene.confidence = {name: one.confidence for name, one in last.estimates.items()}
    path = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2", "lookahead_m")
    shown = ("mode", "fear", "level", "cause", "rules", "rule_strengths", "path_source", "speed_cap_mps")
    seen.scene.path = {name: getattr(last.decision, name) for name in (*path, *shown)}
    seen.scene.speed_mps, seen.scene.lead_m = last.state.speed_mps, None
    assert seen.becomes("legend-lead", "none") and seen.becomes("mode", str(last.decision.mode))
    assert until(lambda: min(seen.pixel(0.5, 0.05)) > 100, patience_s=PATIENCE_S), (
        "the sky of the rendered road"
    )
    time.sleep(5)  # for the timelines
    seen.js(
        "document.getElementById('notice').hidden = true; document.getElementById('kept').textContent = ''"
    )
    data = seen.browser.execute_cdp_cmd("Page.captureScreenshot", {"format": "jpeg", "quality": 80})["data"]
    shot = tmp_path / "page.jpg"
    shot.write_bytes(base64.b64decode(data))
    if os.environ.get("TREPID_SCREENSHOT"):
        (ROOT / "docs" / "page.jpg").write_bytes(shot.read_bytes())
    stored = cv2.imread(str(ROOT / "docs" / "page.jpg"))
    assert stored is not None and stored.shape == cv2.imread(str(shot)).shape
    assert (ROOT / "docs" / "page.jpg").stat().st_size <= 200_000
    assert "![" in (page := (ROOT / "docs" / "page.md").read_text(encoding="utf-8")) and "(page.jpg)" in page


def driven() -> Instant:
    """The last instant of a short rendered drive."""
    kept = {}

    def witness(now: Instant) -> None:
        if now.frame is not None and now.decision is not None and all(now.estimates.values()):
            kept["last"] = now

    run(load_scenario("circuit", {"duration_s": "6"}), seed=1, witness=witness)
    return kept["last"]


def test_the_page_is_small():
    assert sum(path.stat().st_size for path in STATIC.iterdir()) <= 300_000
