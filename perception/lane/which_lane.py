"""The estimator `cv` without a camera file: which lane is that of the car.

Two finders look at each frame: the search between likely heights of the camera (:mod:`.unknown_camera`), which is
precise where both boundaries of a lane are of one kind, and the pairs of boundaries of a street
(:mod:`.street_finder`), of any kinds. The more probable lane is reported (:mod:`.street.rating`); each counts for
the other where they agree, and against it where they do not. Of two that agree, one that its own finder doubts is
not reported: the search may remember one that slid off the boundaries of the road.

In masks (``bounded``) a pair is at most as sure as its share among all pairs: of equal hypotheses none is sure.

The image counts down to the lower end of the road, where a bonnet is visible (:mod:`perception.camera.lower_end`):
its grey level is not that of the road, and no pixel of it shows a boundary.

Where the lines of the road meet above the image, there is no horizon to measure by, and no lane is reported.

The pairs are hypotheses kept over time: those of a frame, moved with the vehicle, weigh the pairs of the next one.
The side of the traffic is that of the car file, or learned from kerbs beside lines.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from perception.camera.lower_end import SAME, LowerEnd
from perception.camera.odometry import DriveOptics, StateOdometry
from perception.camera.self_calibration import LooksDown
from perception.camera.uncertainty import CameraBelief, with_camera_doubt
from perception.lane.agreement import agreement, lane_columns
from perception.lane.detection.evenness import unevenness
from perception.lane.detection.marks import marks
from perception.lane.detection.shown import visible_share
from perception.lane.lane_cv import NAME, lane_estimate
from perception.lane.light import brighten_road
from perception.lane.model.geometry import KAPPA, KAPPA_RATE, WIDTH, E, LaneState
from perception.lane.model.prediction import VehicleMotion
from perception.lane.settings import LaneCvSettings
from perception.lane.street.pairs import Boundary, BoundaryKind, Pair, chosen_share, kerb_side
from perception.lane.street.profile import StreetCourse
from perception.lane.street.rating import either, probability_of, searched_features, street_features
from perception.lane.street_finder import StreetLane, street_lane
from perception.lane.unknown_camera import LaneOfUnknownCamera
from perception.lane.view import as_bgr, unusable
from trepid.car.camera import Camera
from trepid.car.vehicle import Traffic, Vehicle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.types import Image

KEPT = 5  # pairs that are kept
FORGET_S = 1.0  # after a longer pause nothing is kept
UNEVEN = 2.0  # of a lane of which too little is visible
MIN_AGREEMENT = 0.9  # from which both finders have the same lane
PROBABLE = 0.5  # lane of the search on its own, whose more precise place is reported
NO_HORIZON = "the camera looks too far down to find the horizon, and with it distances; give its camera file"
OTHER_LANE = "at other likely heights of the camera, or beside it, it is another lane"


@dataclass(frozen=True, slots=True)
class FinderLane:
    """The lane of one finder, and the features of its probability."""

    estimate: SteeringEstimate
    features: tuple[float, ...]


@dataclass(frozen=True)
class RememberedFrame:
    """What is remembered of a frame."""

    t_s: float
    course: StreetCourse
    pairs: tuple[Pair, ...]


class WhichLane:
    """Estimator "cv" without a camera file. Its state: the search, the kept pairs, the side of the traffic."""

    def __init__(
        self,
        settings: LaneCvSettings,
        camera: Camera,
        vehicle: Vehicle,
        odometry: StateOdometry = StateOdometry.WAY_AND_TURN,
        *,
        bonnet: bool = True,
    ) -> None:
        """``camera``: a self-calibrated one, with the medians of the belief.

        ``bonnet``: whether images may show one; they then count down to it.
        """
        self._settings, self._vehicle, self._whole_px = settings, vehicle, camera.height_px
        self._lower_end, self._end = LowerEnd() if bonnet else None, 1.0
        self._searched = LaneOfUnknownCamera(settings, camera, vehicle)
        self._drive = DriveOptics(camera, odometry)
        self._looks_down = LooksDown(settings.self_calibration)
        self._last: tuple[Frame, SteeringEstimate] | None = None
        self._kept: RememberedFrame | None = None
        self._traffic_log_odds = 0.0  # of left-hand traffic, learned
        self.looks: tuple[FinderLane, ...] = ()  # of the last frame: of the search, then of the pair if any

    @property
    def on_left(self) -> float:
        """Probability of left-hand traffic."""
        known = {Traffic.LEFT: 1.0, Traffic.RIGHT: 0.0}
        return known.get(self._vehicle.traffic, 1 / (1 + math.exp(-self._traffic_log_odds)))

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The more probable lane of both finders, with its probability as confidence.

        The same frame again has the same estimate, because several estimators may use one finder.
        """
        if self._last is None or self._last[0] is not frame:
            self._last = frame, self._find_lane(frame, state, now_s=now_s)
        return self._last[1]

    def _find_lane(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        if unusable(frame.image):
            return self._searched.step(frame, state, now_s=now_s)
        if self._looks_down.update(frame.image):
            self.looks, self._kept = (), None
            return SteeringEstimate.nothing(
                frame.t_s, estimator=NAME, lookahead_m=self._settings.steering.lookahead_m, reason=NO_HORIZON
            )
        street, motion, before = self._settings.street, VehicleMotion.of(state), self._searched.camera
        found = self._drive.step(frame.image, frame.t_s, motion.speed_mps, motion.yaw_rate_radps)
        if found is not None:
            self._searched.add_optics(found)
        road = self._above_own_car(frame)
        light = brighten_road(as_bgr(road.image), grey=street.day_grey, max_gain=street.max_gain)
        road = replace(road, image=light)
        searched = self._searched.step(road, state, now_s=now_s)
        if self._searched.camera is not before:
            self._kept = None  # its pairs are in the metres of another camera
        lane = self._choose_lane(searched, self._street(road, motion), road)
        return lane if len(road.image) == len(frame.image) else _with_near_end(lane, len(frame.image))

    def _above_own_car(self, frame: Frame) -> Frame:
        """``frame`` down to the lower end of the road; the search begins anew where that is another one."""
        if self._lower_end is None:
            return frame
        horizon = self._searched.camera.horizon_row_px / self._whole_px
        end = self._lower_end.step(as_bgr(frame.image), horizon=horizon)
        if abs(end - self._end) > SAME:
            self._end = end
            self._searched.cut_images(round(end * self._whole_px))
        return replace(frame, image=frame.image[: round(self._end * len(frame.image))])

    @property
    def camera(self) -> Camera:
        """The camera as known so far."""
        return self._searched.camera.model_copy(update={"height_px": self._whole_px})

    @property
    def belief(self) -> CameraBelief:
        """What is known of the camera."""
        return self._searched.belief

    def _street(self, frame: Frame, motion: VehicleMotion) -> StreetLane | None:
        """The most probable pair of the street; updates what is kept."""
        kept, belief = self._kept, self.belief
        if kept is not None and not 0 < frame.t_s - kept.t_s < FORGET_S:
            kept = None
        lane = street_lane(
            frame.image,
            self._searched.camera.resize(frame.image.shape[1], frame.image.shape[0]),
            self._settings,
            height_sigma=belief.height_sigma,
            on_left=self.on_left,
            near=kept.course if kept else None,
            before=move_pairs(kept, motion, frame.t_s) if kept else (),
        )
        self._kept = None
        if lane is not None:
            self._kept = RememberedFrame(frame.t_s, lane.profile.course, (lane.pair, *lane.rest)[:KEPT])
            self._learn_traffic(lane)
        return lane

    def _learn_traffic(self, lane: StreetLane) -> None:
        settings = self._settings.street.pairs
        side = kerb_side(lane.pair, lane.profile, settings) * lane.pair.probability
        limit = settings.max_traffic_log_odds
        log_odds = self._traffic_log_odds + settings.traffic_log_odds * side
        self._traffic_log_odds = min(max(log_odds, -limit), limit)

    def _choose_lane(
        self, searched: SteeringEstimate, lane: StreetLane | None, frame: Frame
    ) -> SteeringEstimate:
        """The more probable one of both lanes."""
        weights, (height, width) = self._settings.street, frame.image.shape[:2]
        if lane is None:
            self.looks = (FinderLane(searched, _of_search(searched, frame.image, 0.0, 0.0)),)
            rated = probability_of(self.looks[0].features, weights.searched)
            return _with_confidence(searched, min(rated, searched.confidence))
        paired = self._estimate(lane, frame.t_s)
        same = agreement(lane_columns(searched, height, width), lane_columns(paired, height, width))
        of_search = _of_search(searched, frame.image, lane.pair.probability, same)
        kinds = lane.pair.left.kind, lane.pair.right.kind
        which = kinds[0] != BoundaryKind.MIDDLE, kinds[1] != BoundaryKind.MIDDLE
        path = paired.left_boundary_px, paired.right_boundary_px
        of_pair = street_features(
            lane.pair.probability,
            steps=sum(kind != BoundaryKind.LINE for kind in kinds),
            uneven=UNEVEN if (uneven := unevenness(frame.image, *path)) is None else uneven,
            offset_m=lane.pair.offset_m,
            agreement=same,
            searched=searched.confidence,
            shown=visible_share(frame.image, *path, which=which) or 0.0,
            along=marks(frame.image, *path, which=which).along,
        )
        self.looks = FinderLane(searched, of_search), FinderLane(paired, of_pair)
        most = either(searched.confidence, lane.pair.probability, agreement=same)
        both_ways = 1 - lane.pair.one_lane
        by_search = min(probability_of(of_search, weights.searched), most) * (1 - same * both_ways)
        by_pair = probability_of(of_pair, weights.pair) * (1 - both_ways)
        if not all(which):  # no pixel shows the middle of a road
            by_pair = min(by_pair, lane.pair.probability)
        among = chosen_share((lane.pair, *lane.rest), weights.pairs)
        by_pair = min(by_pair, 1 - weights.bounded * (1 - among))
        if same >= MIN_AGREEMENT and searched.lanes_detected == 2 and searched.confidence >= PROBABLE:
            return replace(searched, confidence=max(by_search, by_pair))
        best = (searched, by_search) if by_search >= by_pair else (paired, by_pair)
        return _with_confidence(*best)

    def _estimate(self, lane: StreetLane, t_s: float) -> SteeringEstimate:
        """The estimate for ``lane``; metres are those of the mean height given the pair."""
        seen, pair = lane.fit.boundaries_seen, lane.pair
        marked = pair.left.kind == pair.right.kind == BoundaryKind.LINE
        estimate = lane_estimate(
            lane.fit.state, lane.camera, self._settings, self._vehicle,
            t_s=t_s, confidence=0.0, lanes_detected=seen, reason="", marked=marked, end_m=lane.fit.end_m,
        )  # fmt: skip
        metres = lane_estimate(
            scale_lane(lane.fit.state, pair.height), lane.camera, self._settings, self._vehicle,
            t_s=t_s, confidence=0.0, lanes_detected=seen, reason="", marked=marked,
            end_m=pair.height * lane.fit.end_m,
        )  # fmt: skip
        drawn = {name: getattr(estimate, name) for name in ("left_boundary_px", "right_boundary_px")}
        return replace(with_camera_doubt(metres, self.belief), **drawn)


def _of_search(
    searched: SteeringEstimate, image: Image, street: float, agreement: float
) -> tuple[float, ...]:
    """Features of the lane of the search."""
    return searched_features(
        searched.confidence,
        marked=bool(searched.marked),
        offset_m=searched.lateral_offset_m or 0.0,
        agreement=agreement,
        street=street,
        shown=visible_share(image, searched.left_boundary_px, searched.right_boundary_px) or 0.0,
        marks=marks(image, searched.left_boundary_px, searched.right_boundary_px),
    )


def _with_near_end(lane: SteeringEstimate, height_px: int) -> SteeringEstimate:
    """``lane`` with boundaries that go on straight to the lower edge of an image, under the own car."""
    left_px, right_px = (
        _to_lower_edge(path, height_px) for path in (lane.left_boundary_px, lane.right_boundary_px)
    )
    return replace(lane, left_boundary_px=left_px, right_boundary_px=right_px)


def _to_lower_edge(path: PixelPath, height_px: int) -> PixelPath:
    if len(path) < 2:
        return path
    (x_px, row), (next_px, next_row) = path[:2]
    step_px = row - next_row
    slope = (x_px - next_px) / step_px
    rows = np.arange(row + step_px, height_px + 1, step_px)[::-1].tolist()
    return (*((x_px + slope * (at - row), at) for at in rows), *path)


def _with_confidence(estimate: SteeringEstimate, confidence: float) -> SteeringEstimate:
    """``estimate`` with its confidence, and with a reason where that is low."""
    reason = estimate.reason or (OTHER_LANE if confidence < 1 / 2 else "")
    return replace(estimate, confidence=confidence, reason=reason)


def scale_lane(lane: LaneState, factor: float) -> LaneState:
    """``lane`` of a camera ``factor`` times as high: lengths times ``factor``, curvatures over it."""
    scale = np.ones(len(lane.mean))
    scale[[E, WIDTH]] = factor
    scale[KAPPA], scale[KAPPA_RATE] = 1 / factor, 1 / factor**2
    return LaneState(mean=lane.mean * scale, covariance=lane.covariance * np.outer(scale, scale))


def move_pairs(kept: RememberedFrame, motion: VehicleMotion, t_s: float) -> tuple[Pair, ...]:
    """The kept pairs at ``t_s``: a vehicle with the heading ψ moves v·sin ψ to the left."""
    aside_m = (motion.speed_mps or 0.0) * (t_s - kept.t_s) * math.sin(kept.course.heading_rad)

    def at(boundary: Boundary) -> Boundary:
        return replace(boundary, left_m=boundary.left_m - aside_m)

    return tuple(replace(one, left=at(one.left), right=at(one.right)) for one in kept.pairs)
