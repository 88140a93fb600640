"""The lane that a road is made of: its ids along the lane sections of a file, and where it begins and ends."""

import math
from itertools import pairwise

import numpy as np

from sim_harness.world.opendrive.lane_table import (
    DRIVEN,
    ROUNDING_M,
    LaneSection,
    permanent_lanes,
    successor,
    threads,
)
from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.opendrive.plan_view import SLIVER_M
from trepid.scale import PUBLIC_LANE_M
from trepid.types import Column

NARROWEST_LANE_M = 0.3  # of a model road
EXTENT_STEP_M = 0.5
LEAST_PLACES = 100


class KeptLane:
    """A driving lane through the lane sections of a road."""

    def __init__(self, road: Element, length_m: float, *, lane: int | None, forward_sign: int) -> None:
        """``lane``: its id in the first section; None: the innermost one of the side ``forward_sign`` with a width.

        Raises InputError.
        """
        self._length_m = length_m
        self._all = _lane_sections(road, length_m)
        self.ids = self._first_wide(_candidates(self._all[0], lane, forward_sign))
        self.sections = self._all[: len(self.ids)]
        self.threads = threads(self._all)  # of each section: lane -> number of the lane through all sections
        self.begin_m, self.end_m = self._extent()

    @property
    def name(self) -> str:
        """The lane in the words of a message."""
        return f"lane {self.ids[0]}"

    def index_at(self, s: float) -> int:
        """The number of the lane section at ``s``, at most the last with the lane."""
        return self._index_of(self.ids, s)

    def is_whole(self) -> bool:
        """Whether the lane begins and ends with the road."""
        return self.begin_m == 0.0 and self.end_m == self._length_m

    def notes(self) -> list[str]:
        """What of the road the lane does not have."""
        found, last_m = [], self._last_m
        if last_m < self._length_m:
            found.append(f"{self.name} ends at s = {last_m:g} m of {self._length_m:g} m")
        if self.begin_m > 0.0 or self.end_m < last_m:
            place = f"s = {self.begin_m:.1f} to {self.end_m:.1f} m"
            found.append(f"{self.name} is too narrow outside {place}, left out")
        return found

    @property
    def _last_m(self) -> float:
        """Where the lane ends by its links."""
        count = len(self.ids)
        return self._length_m if count == len(self._all) else self._all[count].start_m

    def _first_wide(self, candidates: list[int]) -> list[int]:
        """The ids along the sections of the first candidate that is anywhere a lane wide, else of the first."""
        first = _follow_links(self._all, candidates[0])
        for other in candidates[1:]:
            if self._widths_m(first)[1].max() >= NARROWEST_LANE_M:
                break
            ids = _follow_links(self._all, other)
            if self._widths_m(ids)[1].max() >= NARROWEST_LANE_M:
                return ids
        return first

    def _widths_m(self, ids: list[int]) -> tuple[Column, Column]:
        """Stations to the end of the lane ``ids``, and its widths there."""
        last_m = self._length_m if len(ids) == len(self._all) else self._all[len(ids)].start_m
        places = np.linspace(0.0, last_m, 1 + max(LEAST_PLACES, math.ceil(last_m / EXTENT_STEP_M)))
        indices = [self._index_of(ids, s) for s in places.tolist()]
        widths = [self._all[i].width_at(ids[i], s, s) for i, s in zip(indices, places.tolist(), strict=True)]
        return places, np.array(widths)

    def _index_of(self, ids: list[int], s: float) -> int:
        return next((i for i in reversed(range(len(ids))) if self._all[i].start_m <= s), 0)

    def _extent(self) -> tuple[float, float]:
        """First and last station of the longest part in which the lane is as wide as a lane. Raises InputError."""
        places, widths_m = self._widths_m(self.ids)
        least_m = PUBLIC_LANE_M if widths_m.max() >= PUBLIC_LANE_M else NARROWEST_LANE_M
        wide = np.flatnonzero(widths_m >= least_m)
        runs = np.split(wide, 1 + np.flatnonzero(np.diff(wide) > 1))
        longest = max(runs, key=len)
        if len(longest) < 2:
            what = f"at most {widths_m.max():.3g} m wide: expected a lane of at least {NARROWEST_LANE_M:g} m"
            raise self.sections[0].lanes[self.ids[0]].error(what)
        return float(places[longest[0]]), float(places[longest[-1]])


def _lane_sections(road: Element, length_m: float) -> list[LaneSection]:
    """The lane sections of ``road`` in order, without those that begin at its end. Raises InputError."""
    found: list[LaneSection] = []
    for element in permanent_lanes(road).all("laneSection"):
        section = LaneSection(element, found[-1] if found else None)
        least_m = found[-1].start_m if found else 0.0
        if section.start_m < least_m - ROUNDING_M or (not found and section.start_m > ROUNDING_M):
            raise element.error(f"s={section.start_m:g}: expected rising s from 0 on")
        found.append(section)
    if not found:
        raise permanent_lanes(road).error("expected at least one <laneSection>")
    return [section for section in found if section is found[0] or section.start_m < length_m - SLIVER_M]


def _candidates(section: LaneSection, lane: int | None, forward_sign: int) -> list[int]:
    """The id of the lane ``lane`` in the first lane section, or all to choose from. Raises InputError."""
    driving = sorted((n for n in section.lanes if n and section.kind(n) in DRIVEN), key=abs)
    if not driving:
        raise section.element.error("expected a lane of type driving")
    if lane is None:
        ahead = [n for n in driving if n * forward_sign > 0]
        return ahead or driving
    if lane not in driving:
        raise section.element.error(f"no driving lane {lane}; there are {', '.join(map(str, driving))}")
    return [lane]


def _follow_links(sections: list[LaneSection], lane: int) -> list[int]:
    """The id of the lane in each section up to its end. Raises InputError for a wrong link."""
    lanes = [lane]
    for here, there in pairwise(sections):
        following = successor(here, there, lanes[-1])
        if following is None:
            break
        if following not in there.lanes or following * lane <= 0:
            raise there.element.error(f"lane {lanes[-1]} ends here: expected a lane {following}")
        lanes.append(following)
    return lanes
