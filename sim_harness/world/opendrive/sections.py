"""Converts stretches of an OpenDRIVE road to the sections of a road of Trepid."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim_harness.world.opendrive.cross_section import (
    SAME_M,
    CrossSection,
    Ends,
    Strip,
    cross_section,
    flipped,
)
from sim_harness.world.opendrive.export import USER_DATA
from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.roads.appearance import Section

JOINED_WITHIN_M = 0.01  # widths that differ by less at a joint are taken as equal


@dataclass(frozen=True, slots=True)
class Profile:
    """A cross section from ``start_m`` over ``length_m`` of the new road, and its <laneSection>."""

    element: Element
    start_m: float
    length_m: float
    lanes: CrossSection


def sections(profiles: Sequence[Profile], lane_width_m: float, *, with_user_data: bool) -> list[Section]:
    """The fewest sections that describe ``profiles``. Raises ValueError (pydantic) for an invalid section."""
    groups: list[Profile] = []
    for profile in profiles:
        longer = _joined(groups[-1], profile) if groups else None
        groups[-1:] = [longer] if longer else [*groups[-1:], profile]
    out: list[Section] = []
    for number, group in enumerate(groups):
        before = groups[number - 1].lanes if number else None
        lanes = _meeting(before, group.lanes) if before else group.lanes
        groups[number] = replace(group, lanes=lanes)
        out.append(_section(groups[number], lane_width_m, with_user_data=with_user_data))
    return out


def user_data(element: Element) -> dict[str, object]:
    """The <userData> that export wrote into ``element``; empty without one. Raises InputError."""
    found = [data for data in element.all("userData") if data.attributes.get("code") == USER_DATA]
    if not found:
        return {}
    try:
        data = json.loads(found[0].text("value"))
    except ValueError as error:
        raise found[0].error(f"value: expected JSON: {error}") from error
    if not isinstance(data, dict):
        raise found[0].error("value: expected a JSON object")
    return data


def mirrored(lanes: CrossSection) -> CrossSection:
    """``lanes`` in the opposite direction."""

    def turned(strips: tuple[Strip, ...]) -> tuple[Strip, ...]:
        return tuple(Strip(strip.width_m[::-1], flipped(strip.marking)) for strip in strips)

    return CrossSection(
        width_m=lanes.width_m[::-1],
        left=flipped(lanes.right),
        right=flipped(lanes.left),
        left_lanes=turned(lanes.right_lanes),
        right_lanes=turned(lanes.left_lanes),
        paved_left_m=lanes.paved_right_m,
        paved_right_m=lanes.paved_left_m,
    )


def _section(profile: Profile, lane_width_m: float, *, with_user_data: bool) -> Section:
    """The section of ``profile``. The lanes override <userData>, so that other tools may edit the file."""
    place: dict[str, object] = {"name": f"at_{profile.start_m:.0f}", "start_m": profile.start_m}
    if with_user_data:
        own = user_data(profile.element)
        base = Section.model_validate({**place, **own})
        if own and cross_section(base, lane_width_m).agrees_with(profile.lanes):
            return base
        place = dict(base)
    return Section.model_validate({**place, **profile.lanes.update()})


def _joined(a: Profile, b: Profile) -> Profile | None:
    """Both profiles as one, None where they differ."""
    if a.element is not b.element or len(_widths(a.lanes)) != len(_widths(b.lanes)):
        return None
    share = a.length_m / (a.length_m + b.length_m)
    ends = [(x[0], y[1]) for x, y in zip(_widths(a.lanes), _widths(b.lanes), strict=True)]
    cuts = [start + (end - start) * share for start, end in ends]
    first = _with_widths(a.lanes, [(start, cut) for (start, _), cut in zip(ends, cuts, strict=True)])
    second = _with_widths(a.lanes, [(cut, end) for (_, end), cut in zip(ends, cuts, strict=True)])
    if not (first.agrees_with(a.lanes) and second.agrees_with(b.lanes)):
        return None
    return Profile(a.element, a.start_m, a.length_m + b.length_m, _with_widths(a.lanes, ends))


def _meeting(before: CrossSection, after: CrossSection) -> CrossSection:
    """``after``, starting with the end widths of ``before`` where both are taken as equal."""

    def start(there: Ends, here: Ends) -> Ends:
        gap_m = abs(there[1] - here[0])
        if abs(here[0] - here[1]) < SAME_M and gap_m < SAME_M:
            return there[1], there[1]
        return (there[1], here[1]) if gap_m < JOINED_WITHIN_M else here

    def strips(there: tuple[Strip, ...], here: tuple[Strip, ...]) -> tuple[Strip, ...]:
        met = [Strip(start(a.width_m, b.width_m), b.marking) for a, b in zip(there, here, strict=False)]
        return (*met, *here[len(met) :])

    return replace(
        after,
        width_m=start(before.width_m, after.width_m),
        left_lanes=strips(before.left_lanes, after.left_lanes),
        right_lanes=strips(before.right_lanes, after.right_lanes),
    )


def _widths(lanes: CrossSection) -> list[Ends]:
    return [lanes.width_m, *(strip.width_m for strip in (*lanes.left_lanes, *lanes.right_lanes))]


def _with_widths(lanes: CrossSection, widths: Sequence[Ends]) -> CrossSection:
    """``lanes`` with ``widths`` in the order of _widths; strips beyond them keep their width."""
    todo = iter(widths[1:])

    def strips(old: tuple[Strip, ...]) -> tuple[Strip, ...]:
        return tuple(Strip(next(todo, strip.width_m), strip.marking) for strip in old)

    left_lanes = strips(lanes.left_lanes)
    return replace(lanes, width_m=widths[0], left_lanes=left_lanes, right_lanes=strips(lanes.right_lanes))
