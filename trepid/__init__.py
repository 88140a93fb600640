"""Trepid: a camera lane keeper for research vehicles with a fuzzy supervisor.

This package is the vocabulary that the others share: messages, topics, the Zenoh bus, camera and vehicle
geometry, configuration, processes and the command line. It holds no driving algorithm.

Conventions everywhere (ISO 8855 / REP 103): x forward, y left, z up; angles, curvature, steering and lateral
offset are positive to the left; SI units, and every name carries its unit.

For notebooks and scripts it offers ``load``, ``estimate``, ``rate``, ``run``, ``sweep``, ``drive``,
``open_recording``, ``compare`` and ``explain`` (docs/python.md). Each is imported from the package that implements
it when it is used first.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cockpit.api import Car, OpenRecording, explain, load, open_recording
    from cockpit.footage.api import estimate
    from drive.api import drive
    from sim_harness.api import run, sweep
    from sim_harness.compare.api import compare
    from sim_harness.footage.api import rate
    from trepid.config import InputError

__version__ = "1.0.0rc1"
__all__ = [
    "Car",
    "InputError",
    "OpenRecording",
    "__version__",
    "compare",
    "drive",
    "estimate",
    "explain",
    "load",
    "open_recording",
    "rate",
    "run",
    "sweep",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """``name`` from the module that defines it; the package is the lowest of all, and its import light."""
        if name in __all__:
            from trepid.config import InputError
            from trepid.packages import offers

            if name == "InputError":
                return InputError
            module = next(one.functions[name] for one in offers() if name in one.functions)
            return getattr(import_module(module), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
