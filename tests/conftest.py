"""Settings of all tests."""

import signal

from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # timing decides no test, on however loaded a machine
settings.load_profile("untimed")


def pytest_configure() -> None:
    """Handle SIGINT also in the background of a script, whose children inherit that it is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
