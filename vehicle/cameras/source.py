"""The interface of camera sources."""

from typing import Any, NamedTuple, Protocol

from trepid import config
from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import Frame

Values = tuple[tuple[str, str], ...]


class SourceContext(NamedTuple):
    """What a camera source may use besides its settings."""

    bus: Bus | None  # None: without the other processes, as in `trepid doctor`
    now_s: Clock  # of the drive


class CameraSource(Protocol):
    """Frames of one camera, stream or recording."""

    def read(self, *, timeout_s: float) -> Frame | None:
        """The newest frame, at the resolution of the source; frames captured before it are dropped.

        ``t_s`` is the time of capture on the clock given at construction, not the time of reading. None when no
        frame comes within ``timeout_s``, for example while the camera is unplugged; a later call tries again.
        The call returns soon after ``timeout_s`` also when the device hangs.
        """
        ...

    @property
    def ended(self) -> bool:
        """True after the last frame of a finite source; a live camera never ends."""
        ...

    @property
    def trouble(self) -> str:
        """Why frames are absent, in a few words; "" while nothing is known to be wrong."""
        ...

    def values(self) -> Values:
        """Names and values for the heartbeat, such as the number of reconnections; empty without any."""
        ...

    def close(self) -> None:
        """Release the device or file."""
        ...


class CameraKind(Protocol):
    """A class of camera sources: what the table and the entry points of ``trepid.cameras`` name."""

    Settings: type[config.Settings]
    """Of the block of ``config/camera_source.yaml`` that has the name of the source."""

    def __call__(self, settings: Any, drive: SourceContext) -> CameraSource:
        """Open the source. Raises InputError with one line for the user when it cannot be opened."""
        ...
