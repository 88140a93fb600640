"""The choice between the candidates of a frame and the remembered lane, and whether a lane follows itself."""

from dataclasses import replace

from perception.lane.frame_search import FrameSearch
from perception.lane.memory import EDGES, LINES, LaneMemory
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import PSI, WIDTH, E, LaneState
from perception.lane.model.lane_in_road import along_road, half_with_vehicle, with_neighbour
from perception.lane.model.prediction import TrackSettings
from perception.lane.rating import Candidate, Rating
from perception.lane.settings import LaneCvSettings

SIDES = (0, 1, -1)  # of a second lane of the road: none, left, right


class LaneChoice:
    """Chooses the lane of each frame.

    Lines come before edges, and the remembered lane before a new one. Scores are compared with scores,
    probabilities with probabilities; the settings ``…_score`` and ``…_probability`` name the scale of each
    limit.
    """

    def __init__(self, settings: LaneCvSettings, rating: Rating) -> None:
        self._settings, self._rating = settings, rating
        self._lines_missing = 0  # frames in a row since the last lines near the remembered lane
        self._layout_misses = 0  # looks for edges in a row without a match
        self._weak_frames = 0  # in a row without a good candidate near the remembered lane
        self._rival_looks = 0  # detections of a better lane elsewhere, in a row

    def choose(self, search: FrameSearch, memory: LaneMemory) -> Candidate | None:
        """The lane detected in a frame; None when the predicted lane of ``memory`` is better than any candidate."""
        if memory.lane is None:
            return self._without_memory(search, memory)
        best = self._with_memory(search, memory)
        return None if best is not None and self._is_pause_of_lines(best, memory) else best

    def _without_memory(self, search: FrameSearch, memory: LaneMemory) -> Candidate | None:
        """Two good lines, else the better of lines and edges."""
        settings = self._settings
        self._lines_missing = self._layout_misses = 0
        lines = self._rate(search.lines_anywhere(), memory)
        if lines.score >= settings.enough_score and lines.fit.boundaries_seen == 2:
            return lines
        edges = self._rate(search.edges_anywhere(), memory)
        if edges.fit.boundaries_seen == 1:
            edges = replace(edges, score=edges.score * settings.evidence.lone_edge_trust)
        if edges.score >= settings.min_score and self._has_two_lanes(edges.fit):
            half = half_with_vehicle(edges.fit.state, settings.prior)
            if half is not None:
                within = self._rate(search.lines_near(half), memory)
                if self._probability(within, memory) > self._probability(lines, memory):
                    lines = within
        best = self._lines_or_edges(lines, edges, memory)
        return best if best.sure or best.score >= settings.min_score else None

    def _with_memory(self, search: FrameSearch, memory: LaneMemory) -> Candidate | None:
        """A good candidate near the remembered lane, else the best one unless a rival elsewhere is better.

        While lines are missing and the edges are good, lines are looked for every ``lines_every`` frames.
        """
        settings, edges = self._settings, None
        if self._lines_missing % settings.track.lines_every:
            edges = self._follow_edges(search, memory)
            if edges.score >= settings.good_score:
                self._lines_missing += 1
                return self._keep(edges, memory)
        lines = self._follow_lines(search, memory)
        self._lines_missing = 0 if lines.score >= settings.min_score else self._lines_missing + 1
        if lines.score >= settings.good_score:
            return self._keep(lines, memory)
        if memory.source == LINES and lines.score >= settings.min_score:
            return self._unless_rival(lines, search, memory)
        edges = edges or self._follow_edges(search, memory)
        if edges.score >= settings.good_score:
            return self._keep(edges, memory)
        return self._unless_rival(self._lines_or_edges(lines, edges, memory), search, memory)

    def _rate(self, fit: LaneFit, memory: LaneMemory) -> Candidate:
        """``fit`` with its score; 0 where it turns off the road that was shown before a gap."""
        candidate = self._rating.candidate(fit)
        return replace(candidate, score=0.0) if memory.is_turned_from(fit) else candidate

    def _follow_lines(self, search: FrameSearch, memory: LaneMemory) -> Candidate:
        """The lines of the predicted lane, or the best lines near it if those are not good.

        A frame has only one of the two looks while lines are missing (in turn), and in both frames of a search
        for a rival.
        """
        predicted, missing = memory.between_lines, self._lines_missing
        if memory.source == LINES and memory.rival is None and (missing == 0 or missing % 2):
            lines = self._rate(search.lines_at(predicted), memory)
            if missing or self._is_rival_due or lines.score >= self._settings.good_score:
                return lines
        return self._rate(search.lines_near(predicted), memory)

    def _follow_edges(self, search: FrameSearch, memory: LaneMemory) -> Candidate:
        """The edges of the predicted road, or of the road around a lane between lines; score 0 without a match.

        As long as lines define the place of the lane, the road may have a second lane on its left or right, and
        the lane keeps its place and width. Each frame tests one layout: the last that matched, and after a miss
        every other frame one of the other two in turn.
        """
        assert memory.lane is not None
        road, track = memory.between_edges, self._settings.track
        if memory.source == EDGES:
            edges = self._rate(search.edges_at(road), memory)
            return edges if _continues(edges.fit, memory.lane, track) else replace(edges, score=0.0)
        keeps_place = memory.lines_define_place
        side = self._layout(memory) if keeps_place else 0
        fit = search.edges_at(with_neighbour(road, memory.lane, side))
        if not _encloses(fit, memory.lane, side, track):
            self._layout_misses += 1
            return replace(self._rating.candidate(fit), score=0.0)
        memory.neighbour, self._layout_misses = side, 0
        if keeps_place:
            fit = replace(fit, state=along_road(memory.lane, fit.state))
        return self._rate(fit, memory)

    def _layout(self, memory: LaneMemory) -> int:
        """The side of the second lane to test: that of the last match, or after a miss one of the others."""
        turn, is_other = divmod(self._layout_misses, 2)
        others = [side for side in SIDES if side != memory.neighbour]
        return others[turn % len(others)] if is_other else memory.neighbour

    def _lines_or_edges(self, lines: Candidate, edges: Candidate, memory: LaneMemory) -> Candidate:
        """The candidate with the higher score, with two exceptions in favour of lines.

        Lines win against improbable edges. Lines with at least ``sure_probability`` win against less probable
        edges of a road of two lanes, whatever their score.
        """
        edges_probability = self._probability(edges, memory)
        if lines.score >= self._settings.min_score and edges_probability < self._settings.min_probability:
            return lines
        if not memory.lines_define_place and self._has_two_lanes(edges.fit):
            lines_probability = self._probability(lines, memory)
            if lines_probability >= max(self._settings.sure_probability, edges_probability):
                return replace(lines, sure=True)
        return lines if lines.score >= edges.score else edges

    def _unless_rival(self, weak: Candidate, search: FrameSearch, memory: LaneMemory) -> Candidate | None:
        """The ``weak`` candidate near the remembered lane, or clearly better lines elsewhere.

        Lines that continue the remembered lane update it, if they are also clearly better than ``weak`` with that
        lane as prior: two short dashes of one frame alone leave width, heading and pitch open to each other. Any
        other rival replaces the remembered lane once it was found ``confirm_looks`` times in a row. The search
        over all lanes is slow, so it begins at the second weak frame in a row and then every ``rival_every``
        frames, and takes two frames: a vote over all shapes, then a fit to the best one.
        """
        track, lane = self._settings.track, memory.lane
        assert lane is not None
        shape, memory.rival = memory.rival, None
        if shape is not None and not weak.sure:
            rival, enough = self._rate(search.lines_like(shape), memory), weak.score + track.rival_margin
            if rival.score > enough:
                if _continues(rival.fit, lane, track):
                    same = self._rate(search.lines_like(shape, memory.between_lines), memory)
                    if same.score > enough:
                        return self._keep(same, memory)
                self._rival_looks += 1
                if self._rival_looks >= track.confirm_looks:
                    memory.looks, memory.width_seen, memory.end_m = 0.0, False, 0.0
                    return self._keep(rival, memory)
            else:
                self._rival_looks = 0
        elif self._is_rival_due and not weak.sure:
            memory.rival = search.shape_anywhere()
            if memory.rival is None:
                self._rival_looks = 0
        self._weak_frames += 1
        return weak if weak.sure or weak.score >= self._settings.min_score else None

    @property
    def _is_rival_due(self) -> bool:
        """Whether a search for a rival begins if this frame is weak."""
        return self._weak_frames % self._settings.track.rival_every == 1

    def _is_pause_of_lines(self, best: Candidate, memory: LaneMemory) -> bool:
        """Whether ``best`` are edges right after lines, less probable than the lane remembered by the lines."""
        if not best.fit.by_edges or memory.source != LINES or memory.by_edges:
            return False
        return self._probability(best, memory) < memory.faded_probability

    def _keep(self, candidate: Candidate, memory: LaneMemory) -> Candidate:
        self._rival_looks = self._weak_frames = 0
        memory.rival = None
        return candidate

    def _has_two_lanes(self, edges: LaneFit) -> bool:
        """Whether the road between ``edges`` is too wide for one lane."""
        evidence = self._settings.evidence
        max_width_m = evidence.road_width_m + evidence.road_width_sigma_m
        return edges.boundaries_seen == 2 and float(edges.state.mean[WIDTH]) > max_width_m

    def _probability(self, candidate: Candidate, memory: LaneMemory) -> float:
        return self._rating.probability_of(candidate, looks=memory.looks)


class SecondLook:
    """Compares a lane between edges with a search that does not know it, in every ``second_every``-th frame.

    Near the remembered lane edges are found in any texture: in fallen snow the borders of patches confirm a lane
    that the road has left, with a probability of 0.7. Where the image shows the edges of the road, a search over
    all shapes finds the same direction; where it finds another one, the lane follows itself.
    """

    def __init__(self, settings: LaneCvSettings) -> None:
        self._settings = settings
        # Frames between edges; share of the looks that agree, of which the newest counts 1/``second_looks``.
        self._frames, self._agreement = 0, 1.0

    def step(self, fit: LaneFit, search: FrameSearch) -> float:
        """Factor of the probability of ``fit``, the lane detected in the frame.

        The share a counts as a/``second_enough``, at most 1, because one look errs more often than a lane that is
        followed. A look that finds no road counts for neither. A frame with lines counts 1/``second_lines`` for the
        lane: a marked road has lines in most frames, the border of a patch half a second before a slow car.
        """
        track = self._settings.track
        if not fit.by_edges:
            self._agreement += (1.0 - self._agreement) / track.second_lines
        else:
            found = search.edges_anywhere() if self._frames % track.second_every == 0 else None
            self._frames += 1
            if found is not None and found.boundaries_seen == 2:
                agrees = abs(self._aside_m(found.state) - self._aside_m(fit.state)) < track.second_gate_m
                self._agreement += (agrees - self._agreement) / track.second_looks
        return min(1.0, self._agreement / track.second_enough)

    def _aside_m(self, lane: LaneState) -> float:
        """By how much ``lane`` leads aside up to the look-ahead [m], + left: its direction, not its place."""
        return lane.clothoid.y_m(self._settings.steering.lookahead_m) - lane.clothoid.y_m(0.0)


def _continues(fit: LaneFit, lane: LaneState, track: TrackSettings) -> bool:
    """Whether offset and heading of ``fit`` are close to those of ``lane``."""
    change = fit.state.mean - lane.mean
    return bool(abs(change[E]) < track.gate_offset_m and abs(change[PSI]) < track.gate_heading_rad)


def _encloses(edges: LaneFit, lane: LaneState, neighbour: int, track: TrackSettings) -> bool:
    """Whether both ``edges`` are parallel to ``lane`` and lie just outside it.

    The edge on the side ``neighbour`` (1 left, −1 right, 0 none) lies outside a second lane on that side,
    whose width is known only roughly. At the mouth of a side road an edge is not parallel to the lane.
    """
    change = edges.state.mean - lane.mean
    if edges.boundaries_seen < 2 or abs(change[PSI]) >= track.edge_gate_heading_rad:
        return False
    outside_m = {side: float(change[WIDTH] / 2 - side * change[E]) for side in (1, -1)}
    if neighbour and abs(outside_m.pop(neighbour) - lane.mean[WIDTH]) >= track.edge_gate_width_m:
        return False
    return all(-track.edge_gate_offset_m < gap_m < track.edge_gate_width_m for gap_m in outside_m.values())
