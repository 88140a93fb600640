"""The estimator `cv` for a camera without a file: one search per likely height of the camera.

The height decides how wide a lane of 3 to 4 m is in the image, and so which pair of lines or edges can be the
lane. Without a camera file, lanes are searched at several heights (:mod:`perception.camera.uncertainty`), and the
probability that lane j is the right one is marginal over them:

    P_j = Σ_i w_i·p_i·a_ij / Σ_i w_i

with the probability p_i that the lane at height i is right, given that height, and the agreement a_ij of the lanes
i and j in the image. The lane with the highest P is reported. The weight w_i of a height is p_i + ``open_mind`` for
a lane between lines, which are as far apart as lanes are wide. The width of a road between edges says little about
the height, because it may have one lane or two: its weight is ``edge_weight`` + ``open_mind``. p_i includes the
surface: a lane whose far half is not the surface right ahead is improbable
(:mod:`perception.lane.detection.evenness`), as is one with a line inside, or between edges as far apart as those of
two lanes (:func:`perception.lane.model.lane_in_road.one_lane_probability`). The confidence is P times the
steadiness, the agreement with the lane in a slightly changed image.

In a clip the widths between two lines, dashes of known length and odometry narrow the belief in height and focal
length (:mod:`perception.camera.evidence`); the search goes on around them.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from perception.camera.evidence import CameraEvidence
from perception.camera.ground_fit import Optics
from perception.camera.uncertainty import CameraBelief, with_camera_doubt
from perception.lane.agreement import agreement, lane_columns, marginal, shift_image, with_noise
from perception.lane.detection.dashes import dash_period
from perception.lane.detection.evenness import unevenness
from perception.lane.lane_cv import LaneCv
from perception.lane.model.lane_in_road import one_lane_probability
from perception.lane.settings import LaneCvSettings
from perception.lane.view import as_bgr, unusable
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import SIGMA_AHEAD_M, Frame, SteeringEstimate, VehicleState
from trepid.types import Array, Image

EQUAL = 0.02  # difference of P
SURE = 0.5  # probability of a lane whose width counts
MATERIAL, SHIFTED = 0.2, 0.02  # of ln σ, and of the camera, by which a new belief differs
OTHER_LANE = "at other likely heights of the camera it is another lane"
CHANGES = (with_noise, shift_image)


@dataclass(frozen=True, slots=True)
class Sighting:
    """The lane found at one height."""

    estimate: SteeringEstimate
    probability: float  # given that height
    explains: float  # 0..1: how well that height explains the frame
    columns_px: Array  # of its boundaries, as `lane_columns` gives them


class LaneOfUnknownCamera:
    """Estimator "cv" without a camera file. Its state: a remembered lane per height, the belief in the camera."""

    def __init__(self, settings: LaneCvSettings, camera: Camera, vehicle: Vehicle) -> None:
        """``camera``: a self-calibrated one, with the medians of the belief."""
        self._settings, self._vehicle, self._limits = settings, vehicle, settings.unknown_camera
        priors, lanes = settings.self_calibration, settings.prior
        self.camera = camera
        self.belief = CameraBelief(camera.height_m, priors.height_sigma, camera.fx_px, priors.focal_sigma)
        self._evidence = CameraEvidence(
            camera,
            self.belief,
            width_m=lanes.width_m,
            width_sigma_m=lanes.width_sigma_m,
            looks=self._limits.width_looks,
        )
        self._begin()

    def _begin(self) -> None:
        """Search at the heights of the belief, without a remembered lane."""
        self._heights_m = self.belief.heights_m
        self._finders = [
            LaneCv(
                self._settings,
                self.camera.model_copy(update={"height_m": height_m}),
                self._vehicle,
                guarded=False,
            )
            for height_m in self._heights_m
        ]
        self._sightings: list[Sighting] = []
        self._chosen, self._frames, self._steadiness = 0, 0, 1.0

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane with the highest probability. The first frame is searched at all heights, others at two."""
        if unusable(frame.image):
            return self._finders[self._chosen].step(frame, state, now_s=now_s)
        look = self._next if self._sightings else self._first
        probability = look(frame, state, now_s)
        self._frames += 1
        lane = self._sightings[self._chosen]
        estimate = lane.estimate
        if not estimate.reason and probability < lane.probability / 2:
            estimate = replace(estimate, reason=OTHER_LANE)
        estimate = replace(
            estimate, confidence=self._steadiness * probability, ahead_sigma_m=self._ahead_sigma_m()
        )
        known_height = replace(self.belief, height_sigma=0.0)  # the lanes at other heights are in the scatter
        self._judge_camera(lane, frame.image)
        return with_camera_doubt(estimate, known_height)

    def _first(self, frame: Frame, state: VehicleState | None, now_s: float) -> float:
        """Searches at all heights, and twice more in changed images at the best one; the probability there."""
        fresh = [finder.twin() for finder in self._finders]
        self._sightings = [self._sighting(finder, frame, state, now_s) for finder in self._finders]
        probability = self._probabilities()
        self._chosen = self._most_likely(probability)
        looks = [self._agreement_in(change(frame.image), fresh, frame, state, now_s) for change in CHANGES]
        self._steadiness = float(np.mean(looks))
        return float(probability[self._chosen])

    def _most_likely(self, probability: Array) -> int:
        """The lane of the highest P; of equal ones that of the height next to the mean over all lanes."""
        log_m = np.log(self._heights_m)
        mean = np.average(log_m, weights=[one.explains + self._limits.open_mind for one in self._sightings])
        equal = probability > probability.max() - EQUAL
        return int(np.where(equal, np.abs(log_m - mean), np.inf).argmin())

    def _next(self, frame: Frame, state: VehicleState | None, now_s: float) -> float:
        """Searches at the chosen height and in turn at another one, which is chosen if it is clearly better."""
        turn, looks = self._frames % len(self._finders), divmod(self._frames, self._limits.steady_every)
        before = [finder.twin() for finder in self._finders] if looks[1] == 0 else []
        for number in {self._chosen, turn}:
            self._sightings[number] = self._sighting(self._finders[number], frame, state, now_s)
        probability = self._probabilities()
        if probability[turn] > probability[self._chosen] + self._limits.change_margin:
            self._chosen = turn
        if before:
            image = CHANGES[looks[0] % len(CHANGES)](frame.image)
            seen = self._agreement_in(image, before, frame, state, now_s)
            self._steadiness += (seen - self._steadiness) / 2
        return float(probability[self._chosen])

    def _sighting(self, finder: LaneCv, frame: Frame, state: VehicleState | None, now_s: float) -> Sighting:
        estimate, limits = finder.step(frame, state, now_s=now_s), self._limits
        columns_px = lane_columns(estimate, frame.image.shape[0], frame.image.shape[1])
        uneven = unevenness(as_bgr(frame.image), estimate.left_boundary_px, estimate.right_boundary_px)
        if uneven is None:
            return Sighting(estimate, 0.0, 0.0, columns_px)
        even = math.exp(-limits.uneven_weight * max(0.0, uneven - limits.uneven_free))
        undivided = max(0.0, 1.0 - finder.line_within / limits.divided_excess)
        probability = estimate.confidence * even * undivided
        if estimate.marked:
            return Sighting(estimate, probability, probability, columns_px)
        probability *= self._one_lane(estimate)
        return Sighting(estimate, probability, limits.edge_weight, columns_px)

    def _one_lane(self, estimate: SteeringEstimate) -> float:
        """Probability that the road between the edges of ``estimate`` is one lane."""
        width_m, offset_m = estimate.lane_width_m, estimate.lateral_offset_m
        if width_m is None or offset_m is None:
            return 0.0
        return one_lane_probability(width_m, offset_m, self._settings.prior, self._settings.evidence)

    def _probabilities(self) -> Array:
        """P of every lane; shape (heights,)."""
        return marginal(
            np.array([one.probability for one in self._sightings]),
            np.array([one.explains + self._limits.open_mind for one in self._sightings]),
            [one.columns_px for one in self._sightings],
        )

    def _agreement_in(
        self, image: Image, finders: list[LaneCv], frame: Frame, state: VehicleState | None, now_s: float
    ) -> float:
        """Agreement of the chosen lane with the one that its finder of ``finders`` finds in ``image`` instead."""
        seen = finders[self._chosen].step(replace(frame, image=image), state, now_s=now_s)
        columns_px = lane_columns(seen, frame.image.shape[0], frame.image.shape[1])
        return agreement(self._sightings[self._chosen].columns_px, columns_px)

    def _ahead_sigma_m(self) -> tuple[float, ...]:
        """σ of the lateral place of the reported lane: its own, and the scatter of the lanes at other heights."""
        own = self._sightings[self._chosen].estimate
        if (place_m := _places_m(own)) is None:
            return ()
        variance, total = np.zeros(len(SIGMA_AHEAD_M)), 0.0
        for one in self._sightings:
            weight = one.explains + self._limits.open_mind
            if (other_m := _places_m(one.estimate)) is not None:
                variance, total = variance + weight * np.square(other_m - place_m), total + weight
        return tuple(np.sqrt(np.square(own.ahead_sigma_m) + variance / total).tolist())

    def _judge_camera(self, lane: Sighting, image: Image) -> None:
        """Adds the lane between two lines, and its dashes where their length is known, to the evidence."""
        estimate, evidence = lane.estimate, self._evidence
        sure = lane.probability > SURE and estimate.marked and estimate.lanes_detected == 2
        if not sure or estimate.lane_width_m is None:
            return
        news = evidence.add_width(estimate.lane_width_m / self._heights_m[self._chosen])
        period_m = self._vehicle.dash_period_m
        if period_m is not None and evidence.awaits_dashes:
            for path in (estimate.left_boundary_px, estimate.right_boundary_px):
                if (period := dash_period(image, path, self.camera.horizon_row_px)) is not None:
                    news |= evidence.add_dashes(period_m / period)
        if news:
            self._search_anew()

    def cut_images(self, height_px: int) -> None:
        """Images have ``height_px`` rows from now on; the search begins anew, the belief in the camera stays."""
        self._evidence.cut_images(height_px)
        self.camera = self.camera.model_copy(update={"height_px": height_px})
        self._begin()

    def add_optics(self, optics: Optics) -> None:
        """Adds all odometry so far to the evidence."""
        if self._evidence.add_optics(optics):
            self._search_anew()

    def _search_anew(self) -> None:
        """The search begins anew where the evidence shows clearly another camera."""
        belief, camera = self._evidence.belief, self._evidence.camera
        change = math.log(belief.height_sigma / self.belief.height_sigma)
        if abs(change) > MATERIAL or _differ(self.camera, camera):
            self.belief, self.camera = belief, camera
            self._begin()


def _places_m(estimate: SteeringEstimate) -> Array | None:
    """Lateral places [m] of the lane centre at SIGMA_AHEAD_M; None without a lane."""
    lane = Lane.of_message(estimate)
    return None if lane is None else np.array([lane.y_m(ahead_m) for ahead_m in SIGMA_AHEAD_M])


def _differ(one: Camera, other: Camera) -> bool:
    """Whether height, focal length or direction of two cameras differ by more than 2 %."""
    lengths = np.log([one.height_m / other.height_m, one.fx_px / other.fx_px])
    angles = one.pitch_down_rad - other.pitch_down_rad, one.yaw_rad - other.yaw_rad
    return bool(np.abs([*lengths, *angles]).max() > SHIFTED)
