"""The lane remembered from earlier frames, and the kind of boundaries that it was detected by."""

import math

from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import LaneState
from perception.lane.model.lane_in_road import lane_within, road_around
from perception.lane.model.prediction import VehicleMotion, predict, steady, travelled_distance_m
from perception.lane.model.prior import looks_straight, on_straight
from perception.lane.model.shown import StraightStretch
from perception.lane.rating import NO_FACTORS, Candidate, Rating
from perception.lane.settings import LaneCvSettings

MIN_UNSEEN_S = 0.25  # a lane is remembered at least this long without detection
LINES, EDGES = "lines", "edges"


class LaneMemory:
    """The remembered lane. It is predicted to each frame, then either updated by a detection or kept."""

    def __init__(self, settings: LaneCvSettings, rating: Rating) -> None:
        self._settings, self._rating = settings, rating
        self.lane: LaneState | None = None
        self.seen_t_s = 0.0  # time of the last detection
        self.looks = 0.0  # detections in a row, at most sure_looks; a part of them after frames without one
        self.factors = NO_FACTORS  # of the last detection
        self.probability = 0.0  # of the last detection
        self.one_lane = 1.0  # ..., that it is not both lanes of a road
        self.confirmed = 1.0  # ..., of edges: that a search without memory finds them
        self.most = 1.0  # ..., the most confidence that pixels give to it
        self.end_m = 0.0  # place ahead of the axle up to which points of any frame support the lane
        self.width_seen = False  # whether both boundaries of the remembered lane were detected together
        self.source = LINES  # the boundaries that define the place and width of the lane
        self.by_edges = False  # whether the last detection was of edges
        self.rival: LaneState | None = None  # a shape elsewhere with the most votes, not yet fitted
        self.neighbour = 0  # side of a second lane of the road: 1 left, -1 right, 0 none
        self._shown: StraightStretch | None = None  # of the road ahead; None in a bend
        self._is_gap = False  # whether the frame before had no detection
        self._t_s = 0.0  # time of `lane`
        self._straight = False  # whether the road was straight at the last detection
        self._unmarked_m = 0.0  # driven since the last detection of lines
        self._unseen_m = 0.0  # ... and of anything
        self._kept = 1.0  # share of the detections that counts after frames without any

    def predict(self, t_s: float, motion: VehicleMotion) -> None:
        """Move the lane and its rival to ``t_s``; forget both when time runs backwards or without detections.

        A lane without detection is remembered for ``max_coast_s``, and for less if its probability was below
        ``good_probability``.
        """
        track = self._settings.track
        if self._shown is not None:
            self._shown = self._shown.after(motion, t_s, max_s=track.max_shown_s)
        if self.lane is None:
            return
        dt_s = t_s - self._t_s
        share = min(1.0, self.probability / self._settings.good_probability)
        if dt_s < 0 or t_s - self.seen_t_s > max(share * track.max_coast_s, MIN_UNSEEN_S):
            self.lane, self.rival, self.looks, self.neighbour = None, None, 0.0, 0
            self.width_seen, self.end_m = False, 0.0
            return
        way_m = travelled_distance_m(motion, dt_s, track)
        self._unmarked_m, self._unseen_m = self._unmarked_m + way_m, self._unseen_m + way_m
        self.end_m = max(self.end_m - way_m, 0.0)
        self.lane = predict(self.lane, dt_s, motion, track=track, prior=self._settings.prior)
        if self.rival is not None:
            self.rival = predict(self.rival, dt_s, motion, track=track, prior=self._settings.prior)
        self._t_s = t_s

    def update(self, found: Candidate, t_s: float) -> LaneState:
        """Replace the lane by ``found`` at ``t_s``; returns the lane to report.

        The reported lane is straight where the road is; the remembered one keeps its bend, because the same
        evidence would otherwise count in every frame. After frames without a detection those before them count
        by the share :attr:`fade` of the remembered lane: chance detections do not persist.
        """
        fit, settings = found.fit, self._settings
        self.looks = min(self._kept * self.looks + 1.0, settings.evidence.sure_looks)
        self._kept, self._unseen_m, self._is_gap = 1.0, 0.0, False
        self.end_m = max(self.end_m, fit.end_m)
        if not fit.by_edges:
            self._unmarked_m = 0.0
        self.source = EDGES if fit.by_edges and not self.lines_define_place else LINES
        self.lane, self.by_edges, self.factors = fit.state, fit.by_edges, found.factors
        self._t_s = self.seen_t_s = t_s
        odds = (settings.edge_fit if fit.by_edges else settings.fit).straight_log_odds
        self._straight = looks_straight(self.lane, settings.prior, log_odds=odds)
        self._shown = StraightStretch.of(fit, t_s, before=self._shown) if self._straight else None
        return self._straighten(self.lane)

    def is_turned_from(self, fit: LaneFit) -> bool:
        """Whether ``fit`` turns where the road was shown straight, after a gap or on the word of one boundary.

        At the mouth of a side road the lines of the lane end, and an edge line leads around the corner.
        """
        doubted = self._is_gap or self.lane is None or fit.boundaries_seen < 2
        if self._shown is None or not doubted:
            return False
        return self._shown.is_left_by(fit, self._settings.track.gate_heading_rad)

    def coast(self) -> LaneState:
        """Keep the predicted lane without a detection, with a constant bend; returns it."""
        assert self.lane is not None
        self._kept, self._is_gap = self.fade, True
        self.lane = steady(self._straighten(self.lane))
        return self.lane

    def _straighten(self, lane: LaneState) -> LaneState:
        return on_straight(lane, self._settings.prior) if self._straight else lane

    @property
    def fade(self) -> float:
        """Factor of the confidence since the last detection: exp(−min(t/``coast_decay_s``, way/``coast_decay_m``)).

        A road changes with the way, and its prediction errs with the way and the time: between two dashes a slow
        car remembers as much as a fast one.
        """
        track = self._settings.track
        return math.exp(
            -min((self._t_s - self.seen_t_s) / track.coast_decay_s, self._unseen_m / track.coast_decay_m)
        )

    @property
    def faded_probability(self) -> float:
        """The probability of the predicted lane without a detection in this frame."""
        assert self.lane is not None
        features = self._rating.features(self.factors, self.lane, looks=self.looks)
        return self.fade * self._rating.probability(features)

    @property
    def lines_define_place(self) -> bool:
        """Whether lines, detected at most ``hold_m`` ago, define the place and width of the lane.

        During that distance edges only give its heading and bend: their distance from the lines is not known,
        and they may widen into a lay-by or the mouth of a side road.
        """
        return (
            self.lane is not None and self.source == LINES and self._unmarked_m <= self._settings.track.hold_m
        )

    @property
    def between_lines(self) -> LaneState:
        """The remembered lane as a prior for lines; within the road if edges define its place."""
        assert self.lane is not None
        return self.lane if self.source == LINES else lane_within(self.lane, self._settings.prior)

    @property
    def between_edges(self) -> LaneState:
        """The remembered lane as a prior for edges; with shoulders if lines define its place."""
        assert self.lane is not None
        return self.lane if self.source == EDGES else road_around(self.lane, self._settings.prior)
