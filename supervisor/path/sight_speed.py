"""The speed from which the car stops within its sight: an inequality beside the rules of fear.

From the speed v, a stop with the deceleration b that begins after the reaction time t takes the way

    d(v) = v·t + v²/(2·b)        t = delay + drive lag + b₀/(2·j)        b = b₀ - b_slope

where b₀ is the demanded deceleration, j the jerk at which the demand grows to it, as in
``controller.speed_limits``, and b_slope what a slope downhill takes before the controller compensates it. The free
way is the sight from the rear axle, less a multiple of its deviation, the front of the car, the way driven since
the frame, and a margin:

    s = sight·exp(-z·σ/sight) - front - v·age - margin

The deviation counts by its share of the sight, because errors of an extinction, of a closing rate and of a row near
the horizon are errors of the logarithm of a distance; a small share gives sight - z·σ.

The cap is the greatest speed with d(v) ≤ s,

    v(s) = 2·s/(t + √(t² + 2·s/b)),    and v(s) = 0 for s ≤ 0.

d rises strictly with v, so that v(s) rises with s, and d(v(s)) = s. A free way that is NaN or None has the cap 0.
``docs/sight.md`` has the proof that a car which obeys the cap stops before whatever stands beyond its sight.

AASHTO, A Policy on Geometric Design of Highways and Streets (2018), section 3.2: stopping sight distance.
"""

import math
from typing import NamedTuple, Self

from pydantic import model_validator

from trepid.bounds import at_least, at_most
from trepid.causes import Cause
from trepid.clothoid import STANDING, Motion
from trepid.config import Settings, wrong_at
from trepid.messages import ImageStatistics
from trepid.types import NonNegative, Positive, PositiveShare

CALM = 5.0
"""Greatest value of the input ``sight`` of the rules: the free way is five stopping distances, or unlimited."""


class Brake(Settings):
    """One way to brake: the deceleration, and the jerk at which the demand grows to it."""

    decel_mps2: Positive
    jerk_mps3: Positive


class DetectorReach(Settings):
    """Where the detector of vehicles ahead finds a vehicle that stands: within the least of these bounds."""

    clear_m: Positive  # from the rear axle, in clear air
    share: PositiveShare  # of a sight that something ends
    aside_m: Positive  # from the straight line ahead: a vehicle on a bend of radius R is √(2·R·aside_m) ahead
    confirm_s: NonNegative  # from the first detection to a leader


class SightSettings(Settings):
    """Section ``sight`` of ``config/supervisor.yaml``."""

    max_m: Positive  # a longer sight is a fault
    sigmas: NonNegative  # z
    margin_m: Positive
    delay_s: NonNegative  # from a decision to the demand at the drive
    unknown_slope_mps2: NonNegative  # b_slope
    memory_s: NonNegative  # a sight is remembered this long, and shrinks by the way driven
    unmeasured_m: Positive  # sight where no image states it any longer: that of the lanes
    unstated_m: Positive  # sight by which perception drives that has never stated one
    comfort: Brake
    firm: Brake  # what speed tracking can do: where this is not enough, the car brakes as in an emergency
    emergency: Brake
    detector: DetectorReach | None = None  # None: no bound, on tracks without other vehicles

    @model_validator(mode="after")
    def _brakes_hold_on_the_slope(self) -> Self:
        for name in ("comfort", "firm", "emergency"):
            if getattr(self, name).decel_mps2 <= self.unknown_slope_mps2:
                raise wrong_at((name, "decel_mps2"), "must be above unknown_slope_mps2")
        return self


class StoppingWay(NamedTuple):
    """The way of a stop as the inequality counts it."""

    decel_mps2: float  # b
    reaction_s: float  # t

    def way_m(self, speed_mps: float) -> float:
        """d(v) [m]; 0 at standstill and in reverse, inf for NaN."""
        if math.isnan(speed_mps):
            return math.inf
        speed_mps = at_least(speed_mps, 0.0)
        return speed_mps * (self.reaction_s + speed_mps / (2.0 * self.decel_mps2))

    def speed_mps(self, free_m: float | None) -> float:
        """v(s) [m/s]: the greatest speed with d(v) ≤ s; 0 for s ≤ 0, NaN and None, inf for inf."""
        if free_m is None or not free_m > 0.0:
            return 0.0
        if free_m == math.inf:
            return math.inf
        # two roots and a hypotenuse: no overflow
        root_s = math.hypot(self.reaction_s, math.sqrt(2.0 / self.decel_mps2) * math.sqrt(free_m))
        return 2.0 * (free_m / (self.reaction_s + root_s))


class ReliableSight(NamedTuple):
    """The sight that the car may rely on now, and the room that it leaves."""

    sight_m: float | None  # from the rear axle; None: not known
    cause: str  # what ends it; "": nothing, or what ends it is watched otherwise
    free_m: float  # s; inf: nothing ends the sight
    cap_mps: float  # the speed that it allows; inf: every one


SAME_SHARE, SAME_M = 0.15, 3.0  # distance behind the end of a sight up to which a vehicle is that end


class SightSpeed:
    """The free way and the speeds that it allows. Remembers the last stated sight for ``memory_s``."""

    def __init__(self, settings: SightSettings, *, front_m: float, drive_lag_s: float) -> None:
        """``front_m``: front bumper ahead of the rear axle."""
        self._settings, self._front_m = settings, front_m

        def stop(brake: Brake, more_s: float = 0.0) -> StoppingWay:
            reaction_s = settings.delay_s + drive_lag_s + brake.decel_mps2 / (2.0 * brake.jerk_mps3)
            return StoppingWay(brake.decel_mps2 - settings.unknown_slope_mps2, reaction_s + more_s)

        self.comfort, self.firm = stop(settings.comfort), stop(settings.firm)
        confirm_s = settings.detector.confirm_s if settings.detector else 0.0
        self.emergency = stop(settings.emergency, confirm_s)
        self._end_m: float | None = None  # the remembered sight less its deviation, from where the car is now
        self._stated_m = 0.0  # the remembered sight as stated, from there too: what ends it is here
        self._cause, self._stated_s = "", -math.inf
        self._now_s: float | None = None

    def step(
        self,
        statistics: ImageStatistics | None,
        motion: Motion | None,
        *,
        age_s: float,
        now_s: float,
        leader_m: float = math.inf,
        bend_1pm: float = 0.0,
        watches: bool = False,
    ) -> ReliableSight:
        """The sight at ``now_s``. ``statistics`` must be fresh or None, and are ``age_s`` old.

        ``motion`` is the last valid one, None before. ``leader_m``: the nearer end of the vehicle ahead that is
        followed, from the rear axle; a sight that ends there is limited by the gap to that vehicle alone. Where a
        detector ``watches`` for vehicles, an emergency stop also fits within its reach on a road of curvature
        ``bend_1pm``.

        Perception that never stated a sight gets the cap of ``unstated_m`` and the cause SIGHT_UNKNOWN; where an
        image has stated one, a sight that is not stated shrinks by the way driven, and is that of the lanes after
        ``memory_s``.
        """
        speed_mps = at_least(abs((motion or STANDING).speed_mps), 0.0)
        dt_s = 0.0 if self._now_s is None else at_least(now_s - self._now_s, 0.0)
        self._now_s = now_s
        stated = self._stated_sight_m(statistics)
        if stated is not None:
            self._end_m, self._stated_m = (sight_m - speed_mps * age_s for sight_m in stated)
            self._cause, self._stated_s = statistics.sight_cause if statistics is not None else "", now_s
        elif self._end_m is not None:
            self._end_m, self._stated_m = self._end_m - speed_mps * dt_s, self._stated_m - speed_mps * dt_s
        lately = now_s - self._stated_s <= self._settings.memory_s
        if self._end_m is None or not lately:
            sight_m, cause = None, str(Cause.SIGHT_UNKNOWN)
            free_m = math.inf if self._stated_s == -math.inf else self._free_m(self._settings.unmeasured_m)
        else:
            sight_m, cause, free_m = self._end_m, self._cause, math.inf
            if cause == Cause.OCCLUDED and self._is_it(leader_m):
                cause = ""
            if cause:
                free_m = self._free_m(sight_m)
        never = self._stated_s == -math.inf
        cap_mps = self.comfort.speed_mps(self._free_m(self._settings.unstated_m) if never else free_m)
        detector = self._settings.detector
        if watches and detector is not None:
            ended_m = sight_m if sight_m is not None and cause else math.inf
            cap_mps = at_most(self._reach_mps(detector, ended_m, bend_1pm), cap_mps)
        return ReliableSight(sight_m, cause, free_m, cap_mps)

    def is_too_fast(self, sight: ReliableSight, motion: Motion | None) -> bool:
        """Whether speed tracking can no longer stop the car within a sight that an image states.

        Half of the margin is left to the errors of the tracking.
        """
        if motion is None or sight.sight_m is None:
            return False
        return motion.speed_mps > self.firm.speed_mps(sight.free_m + self._settings.margin_m / 2.0)

    def share(self, sight: ReliableSight, speed_mps: float | None) -> float | None:
        """The free way over the comfortable stopping distance, 0 to CALM; None where the speed is not known."""
        if speed_mps is None or math.isnan(speed_mps):
            return None
        if not sight.free_m > 0.0:
            return 0.0
        way_m = self.comfort.way_m(speed_mps)
        return CALM if way_m * CALM <= sight.free_m else sight.free_m / way_m

    def _stated_sight_m(self, statistics: ImageStatistics | None) -> tuple[float, float] | None:
        """The sight [m] less its deviation, and as stated; None where a number is missing or impossible."""
        if statistics is None or statistics.sight_m is None or statistics.sight_sigma_m is None:
            return None
        sight_m, sigma_m = statistics.sight_m, statistics.sight_sigma_m
        possible = 0.0 <= sight_m <= self._settings.max_m and 0.0 <= sigma_m < math.inf
        if not possible:
            return None
        less = math.exp(-self._settings.sigmas * sigma_m / sight_m) if sight_m > 0.0 else 0.0
        return sight_m * less, sight_m

    def _free_m(self, end_m: float) -> float:
        return end_m - self._front_m - self._settings.margin_m

    def _is_it(self, leader_m: float) -> bool:
        """Whether the vehicle that is followed is what ends the sight, or stands before its end."""
        return leader_m - self._stated_m <= at_least(SAME_M, SAME_SHARE * self._stated_m)

    def _reach_mps(self, detector: DetectorReach, ended_m: float, bend_1pm: float) -> float:
        """The speed from which an emergency stop fits within the reach of the ``detector``.

        ``ended_m``: a sight that something ends; inf without one.
        """
        reach_m = at_most(detector.share * ended_m, detector.clear_m)
        if bend_1pm * reach_m * reach_m > 2.0 * detector.aside_m:
            reach_m = math.sqrt(2.0 * detector.aside_m / bend_1pm)
        return self.emergency.speed_mps(self._free_m(reach_m))
