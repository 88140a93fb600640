"""A veil is glare where a white source stands in a darker sky, and fog where the sky is even."""

import numpy as np
import pytest

from perception.sight.judge import build, is_glare
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame
from trepid.types import Image

HORIZON = 0.4


def sky(grey: int, source_px: int) -> Image:
    """A sky of one grey level over a dark road, with a white square in it."""
    image = np.full((240, 320, 3), 90, np.uint8)
    image[: round(HORIZON * 240)] = grey
    image[20 : 20 + source_px, 100 : 100 + source_px] = 255
    return image


@pytest.mark.parametrize(
    ("grey", "source_px", "glare"), [(140, 40, True), (140, 0, False), (250, 40, False), (140, 4, False)]
)
def test_a_source_in_a_darker_sky_is_glare_and_an_even_or_white_sky_is_not(
    grey: int, source_px: int, glare: bool
) -> None:
    image = sky(grey, source_px)
    white = float(np.mean(image[..., 0] >= 250))
    settings = build()._glare
    assert is_glare(image, white, HORIZON, settings) is glare
    assert not is_glare(image, white, -0.1, settings)  # no sky in the image


@pytest.mark.parametrize(
    ("kind", "cause"), [(DisturbanceKind.GLARE, "over_exposed"), (DisturbanceKind.FOG, "fog")]
)
def test_the_sight_in_glare_and_in_fog_ends_by_its_own_cause(kind: DisturbanceKind, cause: str) -> None:
    road = load_scenario("straight").build_road()
    spoiled = [Disturbance(kind=kind, grade=5)]
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=3, disturbances=spoiled)
    x_m, y_m = road.position(40.0, 0.0)
    image = renderer.render(x_m, y_m, road.heading_at(40.0), station_m=40.0, t_s=0.0)
    seen = build().step(Frame(t_s=0.0, image=image), None, None, now_s=0.0)
    assert (seen.sight_cause, (seen.sight_m or 0.0) < 100.0) == (cause, True)
