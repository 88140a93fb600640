"""A CAN bus between processes for one test."""

import socket

import can
import pytest

GROUP = "239.74.163.2"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


def bus_options() -> dict[str, int]:
    """Options of python-can for a bus of its own; skips where this machine has no multicast."""
    options = dict(port=free_port(), hop_limit=0)
    try:
        can.Bus(interface="udp_multicast", channel=GROUP, **options).shutdown()
    except can.CanError as error:
        pytest.skip(f"no multicast on this machine: {error}")
    return options
