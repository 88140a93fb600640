"""Things on the ground, hidden by crests and walls."""

from collections.abc import Iterator
from contextlib import contextmanager

from sim_harness.world.render.scene.relief import Relief
from trepid.car.camera import Camera
from trepid.types import Floats, Image

SLACK_M = 1.0  # a thing touches the ground that is this much nearer than its middle


@contextmanager
def behind(image: Image, cover_m: Floats | None, reach_m: float) -> Iterator[None]:
    """Within the context a thing ``reach_m`` from the lens is drawn; after it ``image`` shows what hides it.

    ``cover_m``: distance from the lens of ground and walls, (rows, columns); None: nothing hides things.
    """
    before = None if cover_m is None else image.copy()
    yield
    if cover_m is not None and before is not None:
        hidden = cover_m < reach_m - SLACK_M
        image[hidden] = before[hidden]


def camera_at(camera: Camera, relief: Relief | None, x_m: float, y_m: float) -> Camera:
    """The camera as it sees a thing on the ground at (x, y) in vehicle axes."""
    return camera if relief is None else relief.camera_at(x_m, y_m)
