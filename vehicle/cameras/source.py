"""The interface of camera sources."""

from typing import Protocol

from trepid.messages import Frame


class CameraSource(Protocol):
    """Frames of one camera, stream or recording."""

    def read(self, *, timeout_s: float) -> Frame | None:
        """The newest frame, at the resolution of the source; frames captured before it are dropped.

        ``t_s`` is the time of capture on the clock given at construction, not the time of reading. None when no
        frame comes within ``timeout_s``, for example while the camera is unplugged; a later call tries again.
        """
        ...

    @property
    def ended(self) -> bool:
        """True after the last frame of a finite source; a live camera never ends."""
        ...

    def close(self) -> None:
        """Release the device or file."""
        ...
