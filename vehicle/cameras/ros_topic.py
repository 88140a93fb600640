"""An image topic of a ROS 2 graph over Zenoh (rmw_zenoh); no ROS is needed."""

import time
from contextlib import ExitStack
from typing import Annotated, Literal

from pydantic import Field

from trepid import config
from trepid.bus import Bus, ZenohError, open_bus
from trepid.config import InputError
from trepid.messages import Frame
from trepid.types import Positive
from trepid.wire import WireError
from vehicle.cameras.ros_images import COMPRESSED, IMAGE, ros_image
from vehicle.cameras.source import SourceContext, Values

LEAD_S = 0.05  # of the clock of the sender before that of this machine


class RosTopicSettings(config.Settings):
    """Block ``ros2`` of ``config/camera_source.yaml``."""

    key: Annotated[str, Field(min_length=1)]
    connect: str | None = None  # endpoint of the router; None: the bus of the drive
    type: Literal["Image", "CompressedImage"] = "Image"
    stamp: Literal["header", "arrival"] = "header"
    max_age_s: Positive = 5.0  # of a stamp; an older one is of another clock


class RosTopic:
    """The newest image on a key expression."""

    Settings = RosTopicSettings
    ended = False

    def __init__(self, settings: RosTopicSettings, drive: SourceContext) -> None:
        self._settings, self._now_s = settings, drive.now_s
        self._type = IMAGE if settings.type == "Image" else COMPRESSED
        self._stack = ExitStack()
        self._bus = self._join_bus(drive)
        try:
            self._newest = self._bus.newest(settings.key)
        except ZenohError as error:
            self._stack.close()
            raise InputError(f"key: {settings.key!r} is no key expression of Zenoh: {error}") from error
        self._last_s = 0.0
        self._malformed = 0
        self.trouble = f"no image on {settings.key} yet"

    def _join_bus(self, drive: SourceContext) -> Bus:
        """The bus of the drive, or a session of its own as a client of the router of the graph."""
        connect = self._settings.connect
        if connect is None:
            if drive.bus is None:
                raise InputError("needs the bus of a drive, or connect: the endpoint of the router")
            return drive.bus
        # A client: with the router of rmw_zenoh a peer would have to listen on an address that the graph reaches.
        client = {"mode": "client", "listen/endpoints": []}
        try:
            return self._stack.enter_context(open_bus("ros", drive.now_s, connect=connect, further=client))
        except ZenohError as error:
            raise InputError(
                f"connect: no router answers at {connect}; start rmw_zenohd or correct it"
            ) from error

    def read(self, *, timeout_s: float) -> Frame | None:
        """The newest image since the last call; None when there is none within ``timeout_s``."""
        until_s = time.monotonic() + timeout_s
        arrived = self._newest.take()
        while arrived is None and (left_s := until_s - time.monotonic()) > 0:
            self._bus.wait(left_s)
            arrived = self._newest.take()
        return None if arrived is None else self._frame(*arrived)

    def _frame(self, data: bytes, received_s: float) -> Frame | None:
        try:
            message = ros_image(data, self._type)
            t_s = self._capture_time_s(message.stamp_s, received_s)
            image = message.decode()
        except WireError as error:
            self._malformed += 1
            self.trouble = " ".join(str(error).split())
            return None
        if t_s <= self._last_s:
            self.trouble = "the stamps of the topic do not increase"
            return None
        self._last_s, self.trouble = t_s, ""
        return Frame(t_s=t_s, image=image)

    def _capture_time_s(self, stamp_s: float | None, received_s: float) -> float:
        """Time of capture [s]. Raises WireError for a stamp of another clock: its age is not known."""
        if self._settings.stamp == "arrival":
            return received_s
        if stamp_s is None:
            raise WireError("the images have no stamp: set stamp: arrival")
        if not -LEAD_S <= received_s - stamp_s <= self._settings.max_age_s:
            raise WireError(
                f"the stamps differ from the clock of the drive by {received_s - stamp_s:+z.2f} s: synchronise the"
                " clocks, begin a new drive where one was set during this one, or set stamp: arrival"
            )
        return min(stamp_s, received_s)

    def values(self) -> Values:
        """Origin of the stamps, and the number of refused messages."""
        return (("stamped_by", self._settings.stamp), ("malformed_images", str(self._malformed)))

    def close(self) -> None:
        """Leave the graph."""
        self._stack.close()
