"""Steering by the points where the boundaries leave the picture, Umamaheswari (inventory S04–S06; R [83])."""

import math
from dataclasses import dataclass
from enum import StrEnum

from perception.techniques.image.picture import Boundaries, GroundView
from perception.techniques.steering.rule import (
    Gain,
    ImageLine,
    LevelPicture,
    RoadWheel,
    RuleAngle,
    level_lines,
)
from trepid.types import Positive


def affine_left(inclination_deg: float) -> float | None:
    """The printed left virtual edge, ψ = −(η+45)/3 + 10 [deg to the x axis, y up], of a right edge η < 0 (S04).

    It implies lanes from 4.3 to 33 m wide for one road. None for η ≥ −15°, where ψ would not be positive.
    """
    psi_deg = -(inclination_deg + 45) / 3 + 10
    return psi_deg if psi_deg > 0 else None


def affine_right(inclination_deg: float) -> float | None:
    """The printed right virtual edge, ψ = −(η−45)/3 − 10 [deg], of a left edge η > 0: −affine_left(−η)."""
    mirrored = affine_left(-inclination_deg)
    return None if mirrored is None else -mirrored


def inclination_deg(line: ImageLine) -> float:
    """Angle to the x axis with y up, in (−90, 90]: positive for left edges, negative for right ones."""
    return math.degrees(math.atan2(1.0, -line.m)) if line.m <= 0 else -math.degrees(math.atan2(1.0, line.m))


@dataclass(frozen=True, slots=True)
class Crossings:
    """θ [rad] and φ [px] of S05, both + for a car right of the centre."""

    theta_rad: float
    phi_px: float


def crossings(left: ImageLine, right: ImageLine, picture: LevelPicture) -> Crossings | None:
    """θ = μ₁ − μ₂ and φ = b₁ − b₂ with μ = atan(b/(w/2)), b₁ = h − y_l(0), b₂ = h − y_r(w), both signed (S05).

    θ, φ > 0: the car is right of the centre or points to the right, so steer left: the opposite sign to Sujatha's.
    None for a line that falls to the wrong side.
    """
    if left.m >= 0 or right.m <= 0:
        return None
    half, bottom = picture.width_px / 2, picture.height_px - 1
    b_left = bottom + (left.k - (picture.centre_x_px - half)) / left.m
    b_right = bottom - (picture.centre_x_px + half - right.k) / right.m
    return Crossings(math.atan(b_left / half) - math.atan(b_right / half), b_left - b_right)


class Turn(StrEnum):
    """The columns of the decision table."""

    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"


def decide(phi_px: float, before: Turn, *, enter_px: float = 30.0, leave_px: float = 20.0) -> Turn:
    """Straight for −30 < φ < 30, left above, right below [px of a picture 640 wide] (S06).

    Printed: straight only for μ₁ = μ₂; and "φ varies between 150 to 100" has lost its minus. A turn ends below
    ``leave_px``, so that noise causes no chatter.
    """
    turned = Turn.LEFT if phi_px > 0 else Turn.RIGHT
    if abs(phi_px) > enter_px or (before is turned and abs(phi_px) > leave_px):
        return turned
    return Turn.STRAIGHT


class Umamaheswari:
    """gain·θ of both boundaries, the missing one virtual; 0 while the decision table gives straight (S04–S06).

    The virtual line lies ``width_m`` from the other on the road: cot ψ = W/h − cot|η| of the inclinations.
    ``affine``: the printed virtual edges instead. ``table``: apply the decision table.
    """

    def __init__(
        self, *, gain: Gain = 0.2, width_m: Positive = 3.4, table: bool = False, affine: bool = False
    ) -> None:
        self._gain, self._width_m, self._table, self._affine = gain, width_m, table, affine
        self._turn = Turn.STRAIGHT

    def step(self, boundaries: Boundaries, view: GroundView, dt_s: float) -> RuleAngle | None:
        """The angle for this frame; None without a boundary, or with a single one of wrong inclination."""
        left, right, picture = level_lines(boundaries, view)
        if left is None and right is not None:
            left = self._virtual(right, picture, self._width_m)
        elif right is None and left is not None:
            right = self._virtual(left, picture, -self._width_m)
        found = crossings(left, right, picture) if left is not None and right is not None else None
        if found is None:
            return None
        self._turn = decide(found.phi_px * 640 / picture.width_px, self._turn)
        straight = self._table and self._turn is Turn.STRAIGHT
        return RuleAngle(RoadWheel(self._gain * (0.0 if straight else found.theta_rad)))

    def _virtual(self, other: ImageLine, picture: LevelPicture, aside_m: float) -> ImageLine | None:
        """The missing line, ``aside_m`` to the left of ``other``; both meet at the horizon."""
        if not self._affine:
            return picture.beside(other, aside_m)
        affine = affine_left if aside_m > 0 else affine_right
        angle_deg = affine(inclination_deg(other))
        if angle_deg is None:
            return None
        m = -1 / math.tan(math.radians(angle_deg))
        return ImageLine(m, other.x(picture.horizon_px) - m * picture.horizon_px)
