"""Steering by where the boundaries leave the picture, Umamaheswari (inventory S04–S06; R [83])."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from perception.techniques.image.picture import Boundaries, View
from perception.techniques.steering.level_picture import (
    ImageAngle,
    LevelPicture,
    RoadWheel,
    level_lines,
    road_wheel,
)
from perception.techniques.steering.straight_lane import ImageLine


def virtual_left(right: ImageLine, picture: LevelPicture, *, width_m: float) -> ImageLine:
    """The left line, ``width_m`` from a right one: cot ψ = W/h − cot|η| of the inclinations (S04), m_l = m_r − W/h.

    Printed: :func:`affine_left`, whose ψ(η) means lanes from 4.3 to 33 m wide for one road.
    """
    return picture.beside(right, width_m)


def virtual_right(left: ImageLine, picture: LevelPicture, *, width_m: float) -> ImageLine:
    """The mirror image of :func:`virtual_left`."""
    return picture.beside(left, -width_m)


def affine_left(inclination_deg: float) -> float | None:
    """The printed left virtual edge, ψ = −(η+45)/3 + 10 [deg to the x axis, y up], of a right edge η < 0.

    None where ψ would not be positive, a left edge that falls the wrong way: for η ≥ −15°.
    """
    psi_deg = -(inclination_deg + 45) / 3 + 10
    return psi_deg if psi_deg > 0 else None


def affine_right(inclination_deg: float) -> float | None:
    """The printed right virtual edge, ψ = −(η−45)/3 − 10 [deg], of a left edge η > 0: −affine_left(−η)."""
    mirrored = affine_left(-inclination_deg)
    return None if mirrored is None else -mirrored


@dataclass(frozen=True, slots=True)
class Crossings:
    """Where the boundaries leave the picture: θ [rad] and φ [px] of S05; both + for a car right of the centre."""

    theta_rad: float
    phi_px: float


def crossings(left: ImageLine, right: ImageLine, picture: LevelPicture) -> Crossings | None:
    """θ = μ₁ − μ₂ and φ = b₁ − b₂ with μ = atan(b/(w/2)), b₁ = h − y_l(0), b₂ = h − y_r(w), both signed (S05).

    θ, φ > 0: the car is right of the centre or points to the right, so steer left: the opposite sign to
    Sujatha's. None when a line falls to the wrong side: it leaves the picture elsewhere. Sees offset and
    heading, in one number.
    """
    if left.m >= 0 or right.m <= 0:
        return None
    half, bottom = picture.width_px / 2, picture.height_px - 1
    b_left = bottom + (left.k - (picture.centre_x_px - half)) / left.m
    b_right = bottom - (picture.centre_x_px + half - right.k) / right.m
    return Crossings(math.atan(b_left / half) - math.atan(b_right / half), b_left - b_right)


class Turn(StrEnum):
    """What the decision table says."""

    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"


def decide(phi_px: float, before: Turn, *, enter_px: float = 30.0, leave_px: float = 20.0) -> Turn:
    """Straight for −30 < φ < 30, left above, right below [px of a picture 640 wide] (S06).

    Printed: straight only for μ₁ = μ₂, which never happens: 30 px are a dead band of 5.4°; and "φ varies between
    150 to 100" has lost its minus. A turn ends only below ``leave_px``, so that noise makes no chatter.
    """
    wide, turned = abs(phi_px) > enter_px, Turn.LEFT if phi_px > 0 else Turn.RIGHT
    if wide or (before is turned and abs(phi_px) > leave_px):
        return turned
    return Turn.STRAIGHT


class Umamaheswari:
    """Road-wheel angle [rad], + left: gain·θ, 0 while the decision table says straight (S04–S06)."""

    def __init__(
        self,
        *,
        gain: Annotated[float, Field(gt=0, le=2)] = 0.2,
        width_m: Annotated[float, Field(gt=0)] = 3.4,
        table: bool = False,
        affine: bool = False,
    ) -> None:
        self._gain, self._width_m, self._table, self._affine = gain, width_m, table, affine
        self._turn = Turn.STRAIGHT

    def step(self, boundaries: Boundaries, view: View, dt_s: float) -> RoadWheel | None:
        """The angle for this frame; None without a boundary."""
        left, right, picture = level_lines(boundaries, view)
        left, right = self._both(left, right, picture)
        seen = crossings(left, right, picture) if left is not None and right is not None else None
        if seen is None:
            return None
        self._turn = decide(seen.phi_px * 640 / picture.width_px, self._turn)
        straight = self._table and self._turn is Turn.STRAIGHT
        return road_wheel(ImageAngle(0.0 if straight else seen.theta_rad), gain=self._gain)

    def _both(
        self, left: ImageLine | None, right: ImageLine | None, picture: LevelPicture
    ) -> tuple[ImageLine | None, ImageLine | None]:
        """The pair, the missing one virtual."""
        if left is None and right is not None:
            if self._affine:
                left = _inclined(affine_left(inclination_deg(right)), right, picture)
            else:
                left = virtual_left(right, picture, width_m=self._width_m)
        elif right is None and left is not None:
            if self._affine:
                right = _inclined(affine_right(inclination_deg(left)), left, picture)
            else:
                right = virtual_right(left, picture, width_m=self._width_m)
        return left, right


def inclination_deg(line: ImageLine) -> float:
    """Angle to the x axis with y up, in (−90, 90]: positive for left edges, negative for right ones."""
    return math.degrees(math.atan2(1.0, -line.m)) if line.m <= 0 else -math.degrees(math.atan2(1.0, line.m))


def _inclined(angle_deg: float | None, other: ImageLine, picture: LevelPicture) -> ImageLine | None:
    """The line with this inclination through the point where ``other`` meets the horizon."""
    if angle_deg is None:
        return None
    m = -1 / math.tan(math.radians(angle_deg))
    return ImageLine(m, other.x(picture.horizon_px) - m * picture.horizon_px)
