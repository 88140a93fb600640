"""The grades of each disturbance in physical units: ``config/disturbances.yaml``."""

import numpy as np

from trepid.config import CONFIG_DIR, Settings, load

Grades = tuple[float, float, float, float, float, float]
"""A quantity at the grades 0, 1, ... 5; linear in between."""

CONTRAST_LOST = 3.0  # extinction times meteorological optical range: -ln 0.05


def at(grades: Grades, grade: float) -> float:
    return float(np.interp(grade, range(len(grades)), grades))


def extinction_1pm(visibility_m: Grades, grade: float) -> float:
    """Extinction coefficient β = 3 / visibility, linear between the grades."""
    return CONTRAST_LOST * float(np.interp(grade, range(len(visibility_m)), 1 / np.array(visibility_m)))


class Night(Settings):
    ambient: Grades
    headlight: Grades
    gain: Grades


class Sun(Settings):
    elevation_deg: Grades
    strength: Grades
    stops: Grades


class OverExposure(Settings):
    stops: Grades


class TunnelExit(Settings):
    inside: Grades
    stops: Grades
    adapts_over_m: Grades


class Shadows(Settings):
    share: Grades


class Rain(Settings):
    visibility_m: Grades
    daylight: Grades
    streaks: Grades
    drops: Grades
    wet: Grades


class WetRoad(Settings):
    wet: Grades


class Snow(Settings):
    visibility_m: Grades
    daylight: Grades
    flakes: Grades
    cover: Grades


class Fog(Settings):
    visibility_m: Grades


class Dirt(Settings):
    cover: Grades
    veil: Grades


class MotionBlur(Settings):
    exposure_s: Grades


class RollingShutter(Settings):
    readout_s: Grades


class Noise(Settings):
    gain: Grades


class Jpeg(Settings):
    quality: Grades


class Occlusion(Settings):
    vehicles_per_100m: Grades
    over_line_m: Grades


class DisturbanceTable(Settings):
    """All disturbances; the names are those of ``DisturbanceKind``."""

    night: Night
    low_sun: Sun
    glare: Sun
    over_exposure: OverExposure
    tunnel_exit: TunnelExit
    tree_shadows: Shadows
    building_shadows: Shadows
    bridge_shadows: Shadows
    rain: Rain
    wet_road: WetRoad
    snow: Snow
    fog: Fog
    dirt: Dirt
    motion_blur: MotionBlur
    rolling_shutter: RollingShutter
    noise: Noise
    jpeg: Jpeg
    occlusion: Occlusion


def load_table() -> DisturbanceTable:
    """The table of ``config/disturbances.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "disturbances.yaml", DisturbanceTable)
