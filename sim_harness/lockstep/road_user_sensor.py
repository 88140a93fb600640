"""The sensor of people, cyclists and animals where no camera detects them: exact, or with a detector's errors."""

import math
from collections.abc import Sequence

from sim_harness.lockstep.contact import Outline, Solid, seen_share
from sim_harness.lockstep.road_user_model import RoadUserModel, build_road_user_model
from sim_harness.lockstep.road_users import Walker
from sim_harness.lockstep.vehicle import SimulatedVehicle, SimulatorSettings, load_simulator
from sim_harness.scenarios.road_users import UserSensor
from sim_harness.world.render.scene.people import Kind
from sim_harness.world.roads.road import Road
from sim_harness.world.sight_lines import SightLines, Spot
from sim_harness.world.sight_truth import SightDistance
from trepid.car.camera import Camera
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, load
from trepid.messages import RoadUsers


class RoadUserSensor:
    """Measures the road users ahead of the rear axle that a line of sight from the lens reaches."""

    def __init__(
        self, camera: Camera, settings: SimulatorSettings, model: RoadUserModel | None = None
    ) -> None:
        """Without a ``model`` the measurement is exact."""
        self._camera, self._settings, self._model = camera, settings, model
        self._lines: SightLines | None = None  # of the road of the first step

    def step(self, vehicle: SimulatedVehicle, sight: SightDistance | None = None) -> RoadUsers | None:
        """The road users now; None in a run without any, in which this sensor does not run.

        ``sight``: the true sight of the camera, beyond which a modelled detector finds nobody in fog or darkness.
        """
        walkers = vehicle.road_users
        if not walkers:
            return None
        box, reach_m = vehicle.box, self._settings.road_user_range_m
        if self._model and sight is not None and sight.cause in (Cause.FOG, Cause.DARK):
            reach_m = min(reach_m, sight.distance_m)
        if self._lines is None:
            self._lines = SightLines(vehicle.road)
        numbers = self._visible(box, walkers, vehicle, self._lines, reach_m)
        truth = _exact_users(box, [walkers[number] for number in numbers], t_s=vehicle.now_s)
        return self._model.step(truth, numbers) if self._model else truth

    def _visible(
        self,
        ego: Outline,
        walkers: Sequence[Walker],
        vehicle: SimulatedVehicle,
        lines: SightLines,
        reach_m: float,
    ) -> tuple[int, ...]:
        """Numbers of the road users within ``reach_m`` of the rear axle and in sight."""
        eye_m = (*ego.at(self._camera.x_m, self._camera.y_m), self._camera.height_m)
        solids = [Solid(other.box, other.body.height_m) for other in vehicle.others]
        found = []
        for number, walker in enumerate(walkers):
            ahead_m, left_m = ego.in_axes(*walker.pose[:2])
            within = ahead_m > 0.0 and math.hypot(ahead_m, left_m) <= reach_m
            body = Solid(walker.box, walker.figure.height_m)
            if not within or not self._leads_to(eye_m, walker, vehicle.road, lines):
                continue
            if seen_share(eye_m, body, solids) >= self._settings.road_user_seen_share:
                found.append(number)
        return tuple(found)

    @staticmethod
    def _leads_to(eye_m: tuple[float, float, float], walker: Walker, road: Road, lines: SightLines) -> bool:
        """Whether walls and crests leave the middle of a road user in sight."""
        if lines.hide_nothing:
            return True
        eye, spot = (
            Spot(road.local_coordinates(x_m, y_m)[0], x_m, y_m, up_m)
            for x_m, y_m, up_m in (eye_m, (*walker.pose[:2], walker.figure.height_m / 2))
        )
        return lines.are_free(eye, spot)


def _exact_users(ego: Outline, walkers: Sequence[Walker], *, t_s: float) -> RoadUsers:
    """The exact places and velocities of ``walkers`` in the axes of the vehicle."""
    places = [ego.in_axes(*walker.pose[:2]) for walker in walkers]
    courses = [(walker.speed_mps, walker.pose[2] - ego.yaw_rad) for walker in walkers]
    return RoadUsers(
        t_s=t_s,
        kinds=tuple(walker.figure.kind.value for walker in walkers),
        x_m=tuple(x_m for x_m, _ in places),
        y_m=tuple(y_m for _, y_m in places),
        x_mps=tuple(speed_mps * math.cos(course_rad) for speed_mps, course_rad in courses),
        y_mps=tuple(speed_mps * math.sin(course_rad) for speed_mps, course_rad in courses),
        confidences=(1.0,) * len(walkers),
        detects=tuple(kind.value for kind in Kind),
    )


def build_road_user_sensor(kind: UserSensor, *, seed: int) -> RoadUserSensor | None:
    """The sensor of this kind; None for the camera, whose detector finds them. Raises InputError."""
    if kind is UserSensor.CAMERA:
        return None
    camera, model = load(CONFIG_DIR / "camera.yaml", Camera), None
    if kind is UserSensor.MODELLED:
        model = build_road_user_model(camera, seed=seed)
    return RoadUserSensor(camera, load_simulator(), model)
