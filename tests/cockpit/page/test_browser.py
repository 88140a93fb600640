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


class SeenPage:
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
def viewer(tmp_path_factory):
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
            yield SeenPage(page, publisher, browser)


@pytest.fixture(autouse=True)
def at_ease(viewer):
    """Each test begins with the undisturbed scene on the first tab.

    A stop of the test before can still come: each press that a frozen page process has not answered waits in its
    socket, and a stop is repeated until a heartbeat reports it.
    """
    viewer.js("document.getElementById('tab-drive').click()")

    def is_at_ease() -> bool:
        viewer.scene.__dict__.update(Scene().__dict__)
        viewer.publisher.button.held = False
        return (viewer.text("mode"), viewer.text("stop-word")) == ("KEEP", "STOP")

    assert until(is_at_ease, patience_s=PATIENCE_S), viewer.text("mode")


def test_the_page_shows_what_is_published(viewer):
    assert viewer.becomes("speed", "7.1") and viewer.becomes("cap", "5.0")
    assert viewer.becomes("fear", "0.12") and viewer.text("level") == "low"
    assert viewer.becomes("source", "cv+cnn") and viewer.becomes("legend-cv", "0.91")
    assert viewer.becomes("legend-cnn", "0.42") and viewer.becomes("legend-lead", "23.4 m")
    rules = viewer.js("return [...document.querySelectorAll('#firing li')].map(li => li.textContent)")
    assert rules == [
        "0.75if lane confidence is low then fear is high",
        "0.25if speed is high then fear is low",
    ]
    assert viewer.becomes("now-error", "0.07") and viewer.becomes("now-latency", "22.0")
    assert until(lambda: float(viewer.text("driven")) > 1.0, patience_s=PATIENCE_S)
    table = viewer.js(
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
def test_the_banner_names_mode_and_cause_and_a_change_is_spoken(viewer, change, word, because):
    viewer.scene.decision = {**viewer.scene.decision, **change}
    assert viewer.becomes("mode", word) and viewer.becomes("because", because)
    assert word == "KEEP" or viewer.text("announce") == f"Mode {word}. {because}"
    assert viewer.js("return document.title").startswith(word)


@pytest.mark.parametrize(
    ("width", "height", "mobile"), [(1280, 900, False), (390, 844, True), (844, 390, True)]
)
def test_mode_reason_fear_and_stop_stay_in_sight_however_far_the_page_is_scrolled(
    viewer, width, height, mobile
):
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    viewer.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    words = "stopped: late or lost estimator (cv); waits for a restart of the drive"
    viewer.scene.decision = {**viewer.scene.decision, "mode": Mode.STOP, "waits_for": words, "fear": 1.0}
    try:
        assert viewer.becomes("because", words) and viewer.becomes("fear-now", "1.00")
        viewer.js("window.scrollTo(0, document.body.scrollHeight)")
        assert until(lambda: viewer.js("return window.scrollY") > 200, patience_s=PATIENCE_S)
        for name in ("mode", "because", "fear-now", "fear-level", "stop"):
            box = viewer.js(f"return document.getElementById('{name}').getBoundingClientRect().toJSON()")
            assert 0 <= box["top"] < box["bottom"] <= height and 0 <= box["left"] < box["right"] <= width, (
                name
            )
            middle = (box["left"] + box["right"]) / 2, (box["top"] + box["bottom"]) / 2
            on_top = """const [x, y, name] = arguments;
                        return document.getElementById(name).contains(document.elementFromPoint(x, y))"""
            assert viewer.js(on_top, *middle, name), f"something covers {name}"
    finally:
        viewer.js("window.scrollTo(0, 0)")
        viewer.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize(("width", "mobile"), [(1280, False), (390, True)])
def test_a_message_of_eighty_letters_has_a_column_of_at_least_thirty(viewer, width, mobile):
    size = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": mobile}
    viewer.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    measure = """const cell = document.querySelector('#processes tbody tr:last-child td:last-child');
                 const style = getComputedStyle(cell), canvas = document.createElement('canvas').getContext('2d');
                 canvas.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
                 return [cell.clientWidth, canvas.measureText('n'.repeat(30)).width, cell.scrollWidth];"""
    try:
        assert until(lambda: viewer.js("return window.innerWidth") == width, patience_s=PATIENCE_S)
        wide, needed, scrolled = viewer.js(measure)
        assert wide >= needed and scrolled <= wide
    finally:
        viewer.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_bend_is_known_by_the_commanded_speed_and_a_driver_comes_first(viewer):
    viewer.scene.target_mps = 4.1
    assert viewer.becomes("because", "at most 4.1 m/s: bend")
    viewer.scene.target_mps = None
    assert viewer.becomes("because", "at most 5.0 m/s")


def test_a_stop_of_the_vehicle_itself_is_named_although_the_decision_would_drive(viewer):
    viewer.scene.own_stop = NO_COMMAND
    assert viewer.becomes("mode", "STOP") and viewer.becomes("because", NO_COMMAND)
    assert viewer.becomes("cap", "0.0")
    viewer.scene.own_stop = ""
    assert viewer.becomes("mode", "KEEP")


def test_the_word_of_the_mode_is_legible_from_three_metres(viewer):
    """Letters of 1/200 of the distance are legible for everybody: 15 mm, at 96 pixels per inch 57 pixels."""
    height = """const style = getComputedStyle(document.getElementById('mode'));
                const context = document.createElement('canvas').getContext('2d');
                context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
                return context.measureText('KEEP').actualBoundingBoxAscent;"""
    assert viewer.js(height) >= 57


def test_the_picture_is_the_published_one_with_lines_on_it(viewer):
    viewer.scene.grey = 200
    assert until(lambda: abs(viewer.pixel(0.1, 0.1)[0] - 200) < 6, patience_s=PATIENCE_S)
    red, green, blue = viewer.pixel(95 / 320, 190 / 240)  # on the left line of cv and cnn
    assert max(red, green, blue) - min(red, green, blue) > 60
    label = "return document.getElementById('camera').ariaLabel"
    assert until(lambda: "vehicle ahead at 23 metres" in viewer.js(label), patience_s=PATIENCE_S)


def test_a_warning_before_a_line_stands_at_its_side_of_the_picture_and_sounds_after_a_press(viewer):
    words = "a wheel is about to cross the left edge of the lane"
    bar = "return getComputedStyle(document.getElementById('picture'), '::before').display"
    viewer.js("""window.tones = 0;
                 const start = OscillatorNode.prototype.start;
                 OscillatorNode.prototype.start = function (...at) {
                   window.tones += 1;
                   return start.apply(this, at);
                 };""")
    viewer.scene.decision |= {"line_warning": "left"}
    assert viewer.becomes("line", words) and viewer.js(bar) == "block"
    assert viewer.js("return window.tones") == 0, "no sound before a press"
    viewer.click("sound")
    assert viewer.becomes("sound-state", "on")
    assert until(lambda: viewer.js("return window.tones") >= 2, patience_s=PATIENCE_S)
    viewer.scene.decision |= {"line_warning": ""}
    assert viewer.becomes("line", "") and viewer.js(bar) == "none"
    viewer.click("sound")
    assert viewer.becomes("sound-state", "off")


def test_before_the_drive_begins_the_banner_says_what_it_waits_for_and_is_no_stop(viewer):
    viewer.scene.decision |= dict(mode=Mode.STOP, stop=Stop.COMFORT, cause="no_path")
    viewer.scene.waits = "waiting for the start of the scenario"
    assert viewer.becomes("mode", "WAITING") and viewer.becomes("because", viewer.scene.waits)
    assert viewer.text("task") == "keep clear: it starts by itself"
    assert viewer.js("return document.getElementById('banner').dataset.mode") == "NONE"
    viewer.scene.waits = ""
    assert viewer.becomes("mode", "STOP") and viewer.becomes("task", "keep clear: it drives on by itself")
    viewer.scene.speed_mps = 0.0
    assert viewer.becomes("mode", "STOPPED")


@pytest.mark.parametrize("width", [1301, 1366, 1920])
def test_the_word_of_the_banner_never_covers_a_number(viewer, width):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    viewer.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    viewer.scene.decision |= dict(mode=Mode.CAUTION, fear=0.55, level="medium", sight_m=30.0)
    script = """
        const word = document.createRange(), fear = document.getElementById('fear-figure');
        word.selectNodeContents(document.getElementById('mode'));
        return [word.getBoundingClientRect().right, fear.getBoundingClientRect().left];"""
    try:
        assert viewer.becomes("mode", "CAUTION") and viewer.becomes("sight", "30")
        assert until(lambda: viewer.js("return window.innerWidth") == width, patience_s=PATIENCE_S)
        end_px, next_px = viewer.js(script)
        assert end_px < next_px
    finally:
        viewer.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_value_that_is_absent_is_a_dash_and_silence_is_no_data(viewer):
    viewer.scene.speed_mps = None
    assert viewer.becomes("speed", "–")
    viewer.scene.silent = True
    assert (
        viewer.becomes("mode", "NO DATA")
        and viewer.becomes("fear", "–")
        and viewer.becomes("legend-cv", "none")
    )
    assert until(lambda: "no new picture" in viewer.text("old"), patience_s=PATIENCE_S)
    viewer.scene.silent = False
    assert viewer.becomes("mode", "KEEP")


def test_a_number_of_an_estimator_that_is_not_finite_is_a_dash_and_the_rest_is_shown(viewer):
    viewer.scene.confidence["cv"] = math.nan
    assert (
        viewer.becomes("legend-cv", "–") and viewer.becomes("now-cv", "–") and viewer.text("mode") == "KEEP"
    )
    viewer.scene.lead_m = math.inf
    assert viewer.becomes("legend-lead", "none") and viewer.becomes("mode", "KEEP")
    assert viewer.text("connection") == "live" and viewer.text("legend-cnn") == "0.42"


def test_stop_is_one_press_and_driving_on_takes_two_at_standstill(viewer):
    viewer.click("stop")
    assert viewer.becomes("stop-word", "STOPPED") and viewer.becomes("because", STOPPED)
    assert viewer.publisher.button.held
    viewer.click("release")
    time.sleep(0.3)
    assert viewer.publisher.button.held
    viewer.click("release")
    assert until(lambda: not viewer.publisher.button.held, patience_s=PATIENCE_S)
    assert viewer.becomes("stop-word", "STOP") and viewer.becomes("mode", "KEEP")


def test_a_stop_that_the_car_does_not_confirm_raises_an_alarm_and_goes_on(viewer):
    viewer.scene.deaf = True
    viewer.click("stop")
    assert viewer.becomes("because", "stop button pressed")
    assert until(lambda: "does NOT confirm the stop" in viewer.text("alarm"), patience_s=PATIENCE_S)
    assert viewer.becomes("mode", "KEEP")  # what the car does
    viewer.click("stop")
    time.sleep(0.5)
    assert "does NOT confirm the stop" in viewer.text("alarm") and viewer.text("stop-word") == "stopping"
    viewer.scene.deaf = False
    assert viewer.becomes("stop-word", "STOPPED") and viewer.becomes("alarm", "")
    assert viewer.js("return document.getElementById('alarm').hidden")


def test_a_stop_without_an_answer_is_sent_again_after_a_second(viewer):
    """A request to a page process that is frozen has neither an answer nor an error."""
    os.kill(viewer.page.pid, signal.SIGSTOP)
    try:
        viewer.click("stop")
        assert until(lambda: "NOT delivered" in viewer.text("alarm"), patience_s=PATIENCE_S)
    finally:
        os.kill(viewer.page.pid, signal.SIGCONT)
    assert viewer.becomes("stop-word", "STOPPED") and viewer.becomes("alarm", "")


def test_everything_is_done_by_keyboard(viewer):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def press(*keys: str) -> None:
        ActionChains(viewer.browser).send_keys(*keys).perform()

    def focused_id() -> str:
        return str(viewer.js("return document.activeElement.id"))

    viewer.browser.refresh()
    viewer.becomes("mode", "KEEP")
    press(Keys.TAB)
    assert focused_id() == "stop"  # the first of all
    press(Keys.TAB)
    assert focused_id() == "tab-drive"
    press(Keys.ARROW_RIGHT)
    assert focused_id() == "tab-rules" and not viewer.js("return document.getElementById('rules').hidden")
    assert until(
        lambda: "inputs:" in viewer.js("return document.getElementById('text').value"), patience_s=PATIENCE_S
    )
    order = []
    for _ in range(4):
        press(Keys.TAB)
        order.append(focused_id())
    assert order == ["text", "check", "apply", "reread"]
    press(Keys.ESCAPE)
    assert viewer.becomes("stop-word", "STOPPED")


def test_rules_are_checked_at_their_line_applied_and_marked_with_the_present_values(viewer):
    viewer.click("tab-rules")
    assert viewer.has_sets()
    assert viewer.becomes("value-speed", "7.1") and viewer.becomes("value-lane_confidence", "missing")
    good = viewer.page.rules.read_text(encoding="utf-8")
    at = good.splitlines().index("    risk: rising") + 1
    edit = "const t = document.getElementById('text'); t.value = arguments[0]; t.dispatchEvent(new Event('input'))"
    viewer.js(edit, good.replace("    risk: rising", "    risk: sideways", 1))
    viewer.click("apply")
    assert until(lambda: f":{at}:" in viewer.text("verdict"), patience_s=PATIENCE_S), viewer.text("verdict")
    assert viewer.page.rules.read_text(encoding="utf-8") == good
    row = "const t = document.getElementById('text'); return t.value.slice(0, t.selectionStart).split('\\n').length"
    assert viewer.js(row) == at
    changed = good.replace("# The fear rules.", "# Rules of a test.")
    viewer.js(edit, changed)
    viewer.click("apply")
    assert until(lambda: "applied" in viewer.text("edited"), patience_s=PATIENCE_S), viewer.text("verdict")
    assert viewer.page.rules.read_text(encoding="utf-8") == changed
    assert not list(viewer.page.rules.parent.glob(".fear.yaml.*"))


def test_the_page_survives_the_restart_of_its_server_and_of_the_drive(viewer):
    os.kill(viewer.page.pid, signal.SIGKILL)
    viewer.page.stop()
    assert viewer.becomes("mode", "NO DATA")
    assert until(lambda: "connection" in viewer.text("connection"), patience_s=PATIENCE_S)
    viewer.page.start()
    assert viewer.becomes("connection", "live") and viewer.becomes("mode", "KEEP")


def test_the_page_survives_the_restart_of_the_whole_drive_and_says_so(viewer):
    """Another launcher, bus and clock; the address stays, because port and token do."""
    viewer.page.stop()
    assert viewer.becomes("mode", "ENDED")
    try:
        with (
            LivePage(viewer.page.rules, viewer.page.door, what="another drive") as page,
            page.bus() as bus,
            Publisher(bus, page.clock, Scene()) as publisher,
        ):
            publisher.scene.decision["mode"] = Mode.CAUTION
            page.start()
            assert viewer.becomes("mode", "CAUTION") and viewer.becomes("what", "another drive")
            assert viewer.text("notice").startswith("New drive: another drive, since ")
            assert not viewer.js("return document.getElementById('notice').hidden")
            assert until(lambda: float(viewer.text("driven")) > 0.0, patience_s=PATIENCE_S)
    finally:
        viewer.page.start()
    assert viewer.becomes("mode", "KEEP") and viewer.becomes("what", "a test")
    assert viewer.text("notice").startswith("New drive: a test, since ")


def test_after_a_lost_connection_the_page_says_that_it_is_connected_again(viewer):
    os.kill(viewer.page.pid, signal.SIGKILL)
    viewer.page.stop()
    assert viewer.becomes("mode", "NO DATA")
    time.sleep(1.0)  # a shorter loss is no news
    viewer.page.start()
    assert viewer.becomes("mode", "KEEP")
    assert viewer.text("notice").startswith("Connected again at ")


def test_a_drive_that_ends_says_why_until_the_next_one_begins_and_has_no_car_to_stop(viewer):
    viewer.scene.end = END_WORDS
    assert until(lambda: viewer.text("legend-lead") not in ("", "–"), patience_s=PATIENCE_S)
    time.sleep(0.6)  # the next report of the launcher
    viewer.page.stop()
    assert viewer.becomes("mode", "ENDED") and viewer.becomes("connection", "drive ended")
    assert viewer.text("because").startswith("drive ended at ")
    assert END_WORDS in viewer.text("because")
    assert {viewer.text(f"legend-{name}") for name in ("cv", "cnn", "lead")} == {"–"}
    assert viewer.text("source") == "–" and not viewer.text("firing")
    assert viewer.js("return document.getElementById('stop').disabled")
    time.sleep(3.0)  # the page tries to connect again meanwhile
    assert viewer.text("mode") == "ENDED" and viewer.text("fear-now") == "–"
    viewer.page.start()
    assert viewer.becomes("mode", "KEEP")


def test_a_page_that_fails_to_draw_says_so_and_still_receives(viewer):
    viewer.js("document.getElementById('what').id = 'gone'")
    assert until(lambda: "reload it" in viewer.text("connection"), patience_s=PATIENCE_S)
    assert viewer.becomes("mode", "NO DATA")
    messages = viewer.js("return trepid.messages")
    assert until(lambda: viewer.js("return trepid.messages") > messages + 3, patience_s=PATIENCE_S)
    viewer.browser.get_log("browser")  # its errors are meant
    viewer.browser.refresh()
    assert viewer.becomes("mode", "KEEP")


def test_one_press_keeps_the_last_minutes(viewer):
    viewer.click("keep")
    assert until(lambda: "holds nothing to keep yet" in viewer.text("kept"), patience_s=PATIENCE_S)
    assert viewer.text("kept").startswith("not kept: ")
    ring = Path(os.environ["XDG_STATE_HOME"]) / "trepid" / "ring" / RING
    ring.mkdir(parents=True)
    for number in (1, 2):
        with Recording(ring / f"{number}.mcap", {"fear.yaml": b"rules"}, {"what": "test"}) as part:
            for at_s in (10.0 * number, 10.0 * number + 1):
                decided = to_cdr(decision(at_s))
                part.add(DECISION.key, decided, at_s=at_s)
    viewer.click("keep")
    assert until(lambda: viewer.text("kept").startswith("kept: "), patience_s=PATIENCE_S), viewer.text("kept")
    path = Path(viewer.text("kept").removeprefix("kept: "))
    assert path.parent.name == "kept" and path.stem.endswith("-page")
    assert [at_s for at_s, _ in read_recording(path, DECISION.key).of(DECISION)] == [10, 11, 20, 21]


def test_the_reason_why_nothing_is_kept_goes_with_its_drive(viewer):
    script = """return import('/static/keep.js').then(({ KeepButton }) => {
        const [keep, kept] = ['keep', 'kept'].map(id => document.getElementById(id));
        const button = new KeepButton();
        return ['recorded in a.mcap', ''].map(why => {
            button.show({ no_keep: why });
            return [keep.hidden, kept.textContent];
        });
    });"""
    try:
        assert viewer.js(script) == [[True, "recorded in a.mcap"], [False, ""]]
    finally:
        viewer.browser.get(viewer.page.door.url)


def test_two_viewers_see_the_same_and_a_hidden_one_costs_the_other_nothing(viewer):
    first = viewer.browser.current_window_handle
    viewer.browser.switch_to.new_window("window")
    viewer.browser.get(viewer.page.door.url)
    assert viewer.becomes("mode", "KEEP")
    viewer.scene.decision = {**viewer.scene.decision, "mode": Mode.CAUTION, "fear": 0.55}
    assert viewer.becomes("mode", "CAUTION") and viewer.becomes("fear", "0.55")
    viewer.browser.close()
    viewer.browser.switch_to.window(first)
    assert viewer.becomes("mode", "CAUTION") and viewer.becomes("fear", "0.55")


def test_a_wrong_token_shows_nothing_and_says_what_to_open(viewer):
    good = viewer.page.door.url.partition("#")[2]
    viewer.browser.get("about:blank")
    viewer.browser.get(viewer.page.door.url.replace(good, "wrong"))
    try:
        assert until(lambda: "wrong token" in viewer.text("because"), patience_s=PATIENCE_S)
        assert viewer.text("fear") == "–" and viewer.js("return trepid.messages") == 0
    finally:
        viewer.browser.get("about:blank")
        viewer.browser.get(viewer.page.door.url)
    assert viewer.becomes("mode", "KEEP")
    assert "#" not in viewer.browser.current_url  # others see the address bar
    viewer.browser.refresh()
    assert viewer.becomes("mode", "KEEP")


def test_a_phone_shows_all_without_scrolling_sideways(viewer):
    size = {"width": 360, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    viewer.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        for mode in Mode:
            blind = {"sight_m": None, "sight_cause": "sight_unknown"}  # the longest words of the figures
            viewer.scene.decision = {**viewer.scene.decision, "mode": mode, **blind}
            assert viewer.becomes("mode", str(mode)) and viewer.becomes("sight-cause", "sight unknown")
            width = "return document.documentElement.scrollWidth"  # the charts are drawn anew first
            assert until(lambda width=width: viewer.js(width) <= 360, patience_s=PATIENCE_S)
            word, button = (
                viewer.js(f"return document.getElementById('{name}').getBoundingClientRect().toJSON()")
                for name in ("mode", "stop")
            )
            assert word["right"] <= 360 and button["bottom"] <= 740 and button["height"] >= 48
    finally:
        viewer.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("tab", ["drive", "rules"])
def test_axe_finds_no_fault_for_people_with_a_screen_reader(viewer, scheme, tab):
    axe = Path(pytest.importorskip("axe_core_python").__file__).parent / "axe.min.js"
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    viewer.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    try:
        viewer.js(f"document.getElementById('tab-{tab}').click()")
        viewer.becomes("mode", "KEEP")
        assert tab == "drive" or viewer.has_sets()
        # By the protocol of the developer tools: the page's own policy forbids foreign scripts.
        viewer.browser.execute_cdp_cmd("Runtime.evaluate", {"expression": axe.read_text(encoding="utf-8")})
        found = viewer.browser.execute_async_script("axe.run().then(arguments[0])")
        assert [
            (fault["id"], node["target"], node["failureSummary"])
            for fault in found["violations"]
            for node in fault["nodes"]
        ] == []
    finally:
        viewer.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_motion_is_reduced_where_the_system_asks_for_it(viewer):
    moves = "return getComputedStyle(document.getElementById('arc')).transitionDuration"
    assert viewer.js(moves) != "0s"
    media = {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    viewer.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    assert viewer.js(moves) == "0s"
    viewer.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_no_request_leaves_the_machine_and_the_console_has_no_error(viewer):
    viewer.browser.get_log("browser")  # that of the restarts and wrong tokens before
    viewer.browser.get_log("performance")
    viewer.browser.refresh()
    assert viewer.becomes("mode", "KEEP")
    messages = [json.loads(entry["message"])["message"] for entry in viewer.browser.get_log("performance")]
    requested = [
        m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"
    ]
    origin = viewer.page.door.url.partition("#")[0]
    assert requested and all(url.startswith(origin) for url in requested)
    assert [
        entry for entry in viewer.browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")
    ] == []


def test_the_picture_of_the_page_in_the_docs_is_that_of_a_drive(viewer, tmp_path):
    """``TREPID_SCREENSHOT=1`` writes docs/page.jpg again; else its size and freshness of layout are checked."""
    last = last_instant()
    viewer.scene.picture = encode_jpeg(last.frame).jpeg
    viewer.scene.estimates = dict(last.estimates)
    viewer.scene.confidence = {name: one.confidence for name, one in last.estimates.items()}
    path = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2", "lookahead_m")
    shown = ("mode", "fear", "level", "cause", "rules", "rule_strengths", "path_source", "speed_cap_mps")
    viewer.scene.path = {name: getattr(last.decision, name) for name in (*path, *shown)}
    viewer.scene.speed_mps, viewer.scene.lead_m = last.state.speed_mps, None
    assert viewer.becomes("legend-lead", "none") and viewer.becomes("mode", str(last.decision.mode))
    assert until(lambda: min(viewer.pixel(0.5, 0.05)) > 100, patience_s=PATIENCE_S), (
        "the sky of the rendered road"
    )
    time.sleep(5)  # for the timelines
    viewer.js(
        "document.getElementById('notice').hidden = true; document.getElementById('kept').textContent = ''"
    )
    data = viewer.browser.execute_cdp_cmd("Page.captureScreenshot", {"format": "jpeg", "quality": 80})["data"]
    shot = tmp_path / "page.jpg"
    shot.write_bytes(base64.b64decode(data))
    if os.environ.get("TREPID_SCREENSHOT"):
        (ROOT / "docs" / "page.jpg").write_bytes(shot.read_bytes())
    stored = cv2.imread(str(ROOT / "docs" / "page.jpg"))
    assert stored is not None and stored.shape == cv2.imread(str(shot)).shape
    assert (ROOT / "docs" / "page.jpg").stat().st_size <= 200_000
    assert "![" in (page := (ROOT / "docs" / "page.md").read_text(encoding="utf-8")) and "(page.jpg)" in page


def last_instant() -> Instant:
    """The last instant of a short rendered drive."""
    kept = {}

    def witness(now: Instant) -> None:
        if now.frame is not None and now.decision is not None and all(now.estimates.values()):
            kept["last"] = now

    run(load_scenario("circuit", {"duration_s": "6"}), seed=1, witness=witness)
    return kept["last"]


def test_the_page_is_small():
    assert sum(path.stat().st_size for path in STATIC.iterdir()) <= 300_000
