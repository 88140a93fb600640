"""The explanation of a moment as text for the terminal."""

from collections.abc import Iterator

from cockpit.logbook.story import Story
from supervisor.situation.added import CONFIDENCE
from trepid.car.vehicle import ALONG_THE_MIDDLE, Corridor
from trepid.causes import concerning, in_words, line_words
from trepid.recording.reader import RecordingContent

SHOWN_RULES, SHOWN_CHANGES, SHOWN_RISES = 6, 5, 6
AGED_S = 0.5  # of a decision: an older one is mentioned, for a supervisor decides 25 times a second
SLOWED = 0.9  # of the cruise speed: a lower cap is mentioned
# A larger value of an input means that the quantity does not exist, such as the gap without a leader.
BEYOND = 1e5


def story_text(story: Story) -> str:
    """The explanation as lines of text, the answer first."""
    return "\n".join(_lines(story))


def overview_text(recorded: RecordingContent, found: list[Story]) -> str:
    """One line for each slow-down."""
    lines = [] if recorded.complete else ["(the recording is cut short)"]
    for slow in found:
        until = "the end" if slow["until_s"] is None else f"{slow['until_s']:.2f} s"
        lines.append(
            f"{slow['from_s']:8.2f} s to {until}: {slow['cap_before_mps']:.1f} -> {slow['cap_lowest_mps']:.1f} m/s,"
            f" {slow['mode']}, {concerning(slow['cause'], slow['part'])}, fear {slow['fear']:.2f}"
        )
    lines.append(f"{len(found)} slow-downs by the supervisor" + ("; --at T explains one" if found else ""))
    return "\n".join(lines)


def _lines(story: Story) -> Iterator[str]:
    if not story["complete"]:
        yield f"(the recording is cut short: it ends at {story['to_s']:.1f} s)"
    if story["corridor"] == Corridor.ROAD:
        yield f"The car drove {ALONG_THE_MIDDLE}."
    match story["slowed_by"]:
        case "supervisor":
            yield from _by_supervisor(story)
        case "controller":
            yield from _by_controller(story)
        case _:
            yield from _calm(story)


def _calm(story: Story) -> Iterator[str]:
    others = ", ".join(f"{other_s:.1f} s" for other_s in story["others_s"])
    yield f"The vehicle did not slow down near {story['at_s']:.1f} s" + (
        f"; the nearest slow-downs begin at {others}." if others else "."
    )
    age_s = story["decision_age_s"]
    if age_s < 0.0:
        yield f"No decision had been made yet; the first one followed {-age_s:.2f} s later:"
    elif age_s > AGED_S:
        yield f"The newest decision was {age_s:.2f} s old; none followed in time:"
    speed = "unknown" if story["speed_mps"] is None else f"{story['speed_mps']:.1f} m/s"
    yield (
        f"At {story['moment_s']:.2f} s: mode {story['mode']}, fear {story['fear']:.2f} ({story['level']}),"
        f" {_cause(story)}; speed {speed}, {_cap_words(story)}."
    )
    yield _shown_words(story)
    yield from _line_warning(story)
    yield _sight(story)
    yield from _rules(story, story["rules"])
    yield from _rise(story)
    yield from _estimates(story)
    yield from _timeline(story)


def _shown_words(story: Story) -> str:
    """What page and terminal showed at the moment."""
    return f"The car said: {story['said']}."


def _line_warning(story: Story) -> Iterator[str]:
    """The warning to the driver at the moment."""
    if story["line_warning"]:
        crossing_s = story["line_crossing_s"]
        when = "" if crossing_s is None else f", in {crossing_s:.1f} s"
        yield f"The driver was warned: {line_words(story['line_warning'])}{when}."


def _sight(story: Story) -> str:
    """How far the camera saw, and what ended its sight."""
    sight = story["sight"]
    if sight is None:
        return "The image did not say how far the camera sees."
    by = f": {in_words(sight['sight_cause'])}" if sight["sight_cause"] else ""
    return f"The camera sees {sight['sight_m']:.0f} m{by}."


def _cause(moment: Story) -> str:
    return "no cause" if moment["cause"] == "none" else f"cause {concerning(moment['cause'], moment['part'])}"


def _cap_words(story: Story) -> str:
    cap = f"{story['speed_cap_mps']:.1f} m/s"
    match story["limited_by"]:
        case "stop":
            return f"{story['stop']} stop"
        case "road_user":
            return f"allowed {cap} by {_road_user(story)}"
        case "lead":
            return f"allowed {cap} by the gap to the vehicle ahead"
        case "network":
            return f"allowed {cap} by the driving network"
        case _:
            return f"allowed {cap}"


def _road_user(story: Story) -> str:
    """The person, cyclist or animal that the car waits or slows for."""
    article = "an" if story["road_user"][:1] in "aeiou" else "a"
    return f"{article} {story['road_user']} {story['road_user_m']:.0f} m ahead"


def _rise(story: Story) -> Iterator[str]:
    """The inputs that alone would raise fear to the next level."""
    level, raised_by = story["next_level"], story["raised_by"]
    if level is None:
        yield "\nFear is at its highest level."
    elif raised_by is None:
        yield f"\nNo inputs of the rules are recorded: what would raise fear to {level} is not known."
    elif not raised_by:
        yield f"\nNo input alone would raise fear to {level}."
    else:
        yield f"\nFear would rise to {level} or above by one of these inputs alone, the nearest first:"
        for one in raised_by[:SHOWN_RISES]:
            was, to = _value(one["value"], one["unit"]), _value(one["from"], one["unit"])
            yield f"  {_own_name(one)} {was} -> {to} (cause {one['cause']}).  {one['meaning']}"
        if len(raised_by) > SHOWN_RISES:
            yield f"  and {len(raised_by) - SHOWN_RISES} more"


def _by_supervisor(story: Story) -> Iterator[str]:
    yield _course(story)
    yield _reason(story)
    yield _shown_words(story)
    yield from _line_warning(story)
    yield _sight(story)
    yield from _rules(story, [rule for rule in story["rules"] if rule["adds"] > 0])
    yield from _estimates(story)
    yield from _timeline(story)
    yield ""
    yield _end(story)


def _rules(story: Story, rules: list[Story]) -> Iterator[str]:
    """Those ``rules`` that fired, and the inputs of those that raise fear."""
    yield f"\nRules that fired at {story['moment_s']:.2f} s, by contribution to fear ({story['rules_from']}):"
    for rule in rules[:SHOWN_RULES]:
        yield f"  {rule['adds']:.2f}  {rule['text']}  (strength {rule['strength']:.2f})"
    if len(rules) > SHOWN_RULES:
        yield f"        and {len(rules) - SHOWN_RULES} more"
    if not story["repeats"]:
        yield "  These rules do not reproduce the recorded fear: the drive used other rules."
    if story["inputs"]:
        yield "\nInputs of the rules that raise fear:"
        yield from (_input(item) for item in story["inputs"])


def _course(story: Story) -> str:
    course = story["slow_down"]
    already = ""
    if course["cap_before_mps"] < SLOWED * course["cruise_mps"]:
        since_s = course["full_speed_until_s"]
        known = "not allowed before" if since_s is None else f"last allowed at {since_s:.2f} s"
        already = f" (full speed, {course['cruise_mps']:.1f} m/s, was {known})"
    text = (
        f"At {course['from_s']:.2f} s the speed cap began to fall: from {course['cap_before_mps']:.1f}"
        f" to {course['cap_lowest_mps']:.1f} m/s by {course['lowest_s']:.2f} s{already}"
    )
    if course["speed_before_mps"] is None:
        return f"{text}."
    before, lowest = (f"{course[f'speed_{name}_mps']:.1f}" for name in ("before", "lowest"))
    if before == lowest:
        return f"{text}; the vehicle held {before} m/s."
    return f"{text}; the vehicle slowed from {before} to {lowest} m/s."


def _reason(story: Story) -> str:
    fear = f"fear {story['fear']:.2f} ({story['level']}), {_cause(story)}"
    match story["limited_by"]:
        case "stop":
            return f"Reason: {story['stop']} stop, {fear}."
        case "road_user":
            return f"Reason: {_road_user(story)}; mode {story['mode']}, {fear}."
        case "lead":
            return f"Reason: time gap to the vehicle ahead; mode {story['mode']}, {fear}."
        case "network":
            return f"Reason: speed that the driving network proposes; mode {story['mode']}, {fear}."
        case _:
            return f"Reason: {fear}; mode {story['mode']}."


def _input(item: Story) -> str:
    sets = ", ".join(f"{level} {degree:.2f}" for level, degree in item["sets"].items())
    value = _value(item["value"], item["unit"])
    return f"  {_own_name(item)} = {value}: {sets}.  {item['meaning']}"


def _own_name(item: Story) -> str:
    """The name of an input; a confidence by the estimators that state it, where rules rate them by another name."""
    name: str = item["name"]
    others = [f"{one}{CONFIDENCE}" for one in item["of"]]
    return name if not others or name in others else f"{', '.join(others)} (as {name})"


def _estimates(story: Story) -> Iterator[str]:
    if not story["estimates"]:
        return
    yield "\nEstimates:"
    for estimate in story["estimates"]:
        if estimate["lateral_offset_m"] is None:
            what = "no lane"
        else:
            what = (
                f"{estimate['lateral_offset_m']:+z.2f} m, {estimate['heading_error_rad']:+z.3f} rad,"
                f" {estimate['curvature_1pm']:+z.4f} 1/m"
            )
        reason = f" ({estimate['reason']})" if estimate["reason"] else ""
        yield (
            f"  {estimate['estimator']}: {what}, confidence {estimate['confidence']:.2f}{reason};"
            f" {1e3 * estimate['age_s']:.0f} ms old, trust {estimate['trust']:.2f}"
        )


def _timeline(story: Story) -> Iterator[str]:
    yield "\nTimeline:"
    for moment in story["timeline"]:
        stop = f" ({moment['stop']})" if moment["stop"] != "none" else ""
        yield (
            f"  {moment['t_s']:7.2f} s  {moment['mode']}{stop}, {_cause(moment)}, fear up to {moment['fear']:.2f},"
            f" path from {moment['path_source']}, speed cap {moment['cap_mps']:.1f} m/s at the end"
        )


def _end(story: Story) -> str:
    end = story["end"]
    if end["relief_s"] is None:
        return "The slow-down had not ended at the end of the recording."
    text = f"Fear had fallen far enough at {end['relief_s']:.2f} s"
    changes = [
        f"{c['name']} {_value(c['was'], c['unit'])} -> {_value(c['is'], c['unit'])}"
        for c in end["changes"][:SHOWN_CHANGES]
    ]
    text += f": {'; '.join(changes)}." if changes else "."
    back = f"Full speed was allowed again at {end['back_s']:.2f} s." if end["back_s"] else ""
    return f"{text} {back or 'Full speed was not allowed again before the end of the recording.'}"


def _by_controller(story: Story) -> Iterator[str]:
    course, bend_1pm = story["slow_down"], story["sharpest_curvature_1pm"]
    yield (
        f"The vehicle slowed from {course['speed_before_mps']:.1f} to {course['speed_lowest_mps']:.1f} m/s between"
        f" {course['from_s']:.2f} and {course['lowest_s']:.2f} s, below the speed cap of the"
        f" supervisor ({story['speed_cap_mps']:.1f} m/s, fear {story['fear']:.2f})."
    )
    if story["driver_override"]:
        yield "Reason: the driver took over."
    elif bend_1pm > 0.0:
        accel = story["commanded_accel_mps2"]
        commanded = (
            "" if accel is None else f", which commanded {accel:+z.1f} m/s² at {story['moment_s']:.2f} s"
        )
        path = f"a bend of {1 / bend_1pm:.0f} m radius" if bend_1pm > 1e-3 else "a straight path"
        yield f"Reason: the controller{commanded}; the path ahead was {path}."
    yield from _estimates(story)
    yield from _timeline(story)


def _value(value: float | None, unit: str) -> str:
    if value is None:
        return "missing"
    if abs(value) > BEYOND:
        return "none"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"
