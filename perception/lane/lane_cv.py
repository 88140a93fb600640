"""The classical lane estimator `cv`: line points or road surface, vote, robust fit, tracking (inventory P04).

For each frame:

1. **Predict** the remembered lane to the capture time with speed and yaw rate (:mod:`.memory`, :mod:`.model`).
2. **Detect** candidates: lanes between painted lines or road edges, near the predicted lane or anywhere
   (:mod:`.frame_search`, :mod:`.detection`).
3. **Choose** one of them, or none if the predicted lane is better (:mod:`.choice`).
4. **Update** the memory with the chosen lane; without one the lane coasts and its confidence fades.
5. **Report** the lane, with the probability that it is right as confidence (:mod:`.rating`). Two things limit it
   where the finder is ``guarded``:

- *Both lanes of a road.* A lane twice as wide as the narrowest one may be two. The probability is then multiplied
  by that of a lane without a line inside and, between road edges, by that of a road of one lane
  (:func:`.model.lane_in_road.one_lane_probability`). This needs widths in metres, and so a known height of the
  camera; for others :mod:`.unknown_camera` weighs both.
- *A boundary that no pixel shows.* With one boundary the other is placed at the usual width. Until both were seen,
  or road ends at that place, half of the lane is a guess, and the confidence is at most one half.
"""

from copy import copy

import numpy as np

from perception.lane.camera_check import CameraCheck
from perception.lane.choice import LaneChoice, SecondLook
from perception.lane.frame_search import FrameSearch
from perception.lane.memory import LINES, LaneMemory
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import WIDTH, LaneState
from perception.lane.model.lane_in_road import one_lane_probability
from perception.lane.model.paths import boundary_paths, known_reach_m
from perception.lane.model.prediction import VehicleMotion, grade_variance_m2, unseen_variance_m2
from perception.lane.rating import Features, Rating
from perception.lane.settings import LaneCvSettings
from perception.lane.view import ViewTables, make_view, unusable
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import SIGMA_AHEAD_M, Frame, SteeringEstimate, VehicleState

ONE_OF_TWO = 0.5  # of a lane, where pixels show one boundary
NAME = "cv"


class LaneCv:
    """Estimator "cv". Its state is the remembered lane."""

    def __init__(
        self, settings: LaneCvSettings, camera: Camera, vehicle: Vehicle, *, guarded: bool = True
    ) -> None:
        """``guarded``: whether a lane that may be two, or a boundary that no pixel shows, limits the confidence.

        Off where the height of the camera is assumed: widths in metres are a guess then.
        """
        self._guarded = guarded
        self._settings, self._vehicle = settings, vehicle
        self.camera, self._view = camera, make_view(settings, camera)
        self._rating = Rating(settings)
        self._memory = LaneMemory(settings, self._rating)
        self._choice = LaneChoice(settings, self._rating)
        self._camera_check = CameraCheck(settings.camera_check)
        self._second_look = SecondLook(settings)
        self._shown: tuple[FrameSearch, LaneState] | None = None  # the last frame and its lane
        self.features: Features | None = None  # of the last confidence; None without a lane

    def twin(self) -> "LaneCv":
        """The same estimator with a state of its own."""
        twin = copy(self)
        twin._memory, twin._choice = copy(self._memory), copy(self._choice)
        twin._camera_check = copy(self._camera_check)
        twin._second_look = copy(self._second_look)
        return twin

    @property
    def line_within(self) -> float:
        """Support of the strongest line inside the last lane detected; 0 without one."""
        return self._shown[0].line_within(self._shown[1]) if self._shown else 0.0

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` gives the motion since the last frame."""
        problem = unusable(frame.image)
        if problem:
            return self._nothing(frame.t_s, problem)
        view = self._view_of(frame.image.shape[1], frame.image.shape[0])
        if view is None:
            return self._nothing(frame.t_s, "the image shows no road")

        motion, memory = VehicleMotion.of(state), self._memory
        memory.predict(frame.t_s, motion)
        search = FrameSearch(view.working_image(frame.image), view, self._settings)
        found = self._choice.choose(search, memory)
        if found is not None:
            self._camera_check.step(found.fit, motion, dt_s=frame.t_s - memory.seen_t_s)
            lane = memory.update(found, frame.t_s)
            self._shown = search, lane
            memory.confirmed = self._second_look.step(found.fit, search)
            if self._guarded:
                memory.one_lane = self._one_lane(lane)
                memory.most = self._most_by_pixels(found.fit, search, lane)
            memory.probability = self._probability(lane)
            seen, reason = found.fit.boundaries_seen, self._camera_check.reason
        elif memory.lane is not None:
            lane = memory.coast()
            seen, reason = 0, f"lane not seen for {frame.t_s - memory.seen_t_s:.2f} s"
        else:
            return self._nothing(frame.t_s, "no lane line or road edge found")
        return lane_estimate(
            lane,
            view.camera,
            self._settings,
            self._vehicle,
            t_s=frame.t_s,
            confidence=memory.fade * self._probability(lane),
            lanes_detected=seen,
            reason=reason,
            marked=not memory.by_edges,
            end_m=memory.end_m,
        )

    def _view_of(self, width_px: int, height_px: int) -> ViewTables | None:
        if (self.camera.width_px, self.camera.height_px) != (width_px, height_px):
            self.camera = self.camera.resize(width_px, height_px)
            self._view = make_view(self._settings, self.camera)
        return self._view

    def _probability(self, lane: LaneState) -> float:
        """The probability that the remembered lane, reported as ``lane``, is right."""
        memory = self._memory
        self.features = self._rating.features(memory.factors, lane, looks=memory.looks)
        probability = memory.confirmed * memory.one_lane * self._rating.probability(self.features)
        return min(probability, memory.most)

    def _one_lane(self, lane: LaneState) -> float:
        """Probability that the detected ``lane`` is not both lanes of a road; 1 where two would not fit into it.

        That between edges is not raised by the place of the vehicle: one in the middle of a road stays there.
        """
        settings, width_m = self._settings, float(lane.mean[WIDTH])
        if width_m < 2 * settings.evidence.min_width_m:
            return 1.0
        undivided = max(0.0, 1.0 - self.line_within / settings.unknown_camera.divided_excess)
        if self._memory.source == LINES:
            return undivided
        places = lane.clothoid.offset_m, None
        single = (one_lane_probability(width_m, at_m, settings.prior, settings.evidence) for at_m in places)
        return undivided * min(single)

    def _most_by_pixels(self, fit: LaneFit, search: FrameSearch, lane: LaneState) -> float:
        """The most confidence that pixels of this frame or of those before give to both boundaries."""
        memory = self._memory
        memory.width_seen = memory.width_seen or fit.boundaries_seen == 2
        if memory.width_seen:
            return 1.0
        edges = search.edges_at(lane)
        return 1.0 if (edges.right if fit.left.seen else edges.left).seen else ONE_OF_TWO

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        self.features = None
        return SteeringEstimate.nothing(
            t_s, estimator=NAME, lookahead_m=self._settings.steering.lookahead_m, reason=reason
        )


def lane_estimate(
    lane: LaneState,
    camera: Camera,
    settings: LaneCvSettings,
    vehicle: Vehicle,
    *,
    t_s: float,
    confidence: float,
    lanes_detected: int,
    reason: str,
    marked: bool,
    end_m: float,
) -> SteeringEstimate:
    """The estimate for ``lane`` at ``t_s``, with its boundaries in the image of ``camera``.

    Pixels support the lane up to ``end_m``; beyond it the deviation grows by :func:`unseen_variance_m2`, and
    everywhere by :func:`grade_variance_m2`.
    """
    clothoid, lookahead_m = lane.clothoid, settings.steering.lookahead_m
    reach_m = known_reach_m(lane, settings.drawn_reach_m, settings.evidence.drawn_sigma_m)
    ahead_m = np.array(SIGMA_AHEAD_M)
    unseen_m2 = unseen_variance_m2(ahead_m, end_m, settings.track)
    unseen_m2 += grade_variance_m2(ahead_m, clothoid, camera, settings.track)
    left, right = boundary_paths(lane, camera, reach_m=reach_m, step_px=settings.drawn_step_px)
    return SteeringEstimate(
        t_s=t_s,
        estimator=NAME,
        lateral_offset_m=clothoid.offset_m,
        heading_error_rad=clothoid.heading_rad,
        curvature_1pm=clothoid.curvature_at(lookahead_m),
        curvature_rate_1pm2=clothoid.curvature_rate_1pm2,
        lookahead_m=lookahead_m,
        road_wheel_angle_rad=road_wheel_angle(
            clothoid.pursuit_curvature(lookahead_m), wheelbase_m=vehicle.wheelbase_m
        ),
        confidence=confidence,
        lanes_detected=lanes_detected,
        lane_width_m=float(lane.mean[WIDTH]),
        reason=reason,
        left_boundary_px=left,
        right_boundary_px=right,
        marked=marked,
        ahead_sigma_m=tuple(np.hypot(lane.ahead_sigma_m, np.sqrt(unseen_m2)).tolist()),
    )
