"""Live devices that hang, disappear and return."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest
from camera_source_rig import FakeCamera, number_of
from process_rig import until

from trepid.config import InputError
from trepid.messages import Frame
from vehicle.cameras.device import MAX_HANGING, Device, DeviceSettings

PATIENCE_S = 20.0
QUICK = DeviceSettings(hang_s=0.2, reopen_s=0.01)


@pytest.fixture
def camera() -> Iterator[FakeCamera]:
    camera = FakeCamera()
    yield camera
    camera.recover()
    camera.unplug()


def device_of(camera: FakeCamera, open_: Callable[[], object] | None = None, **further: object) -> Device:
    return Device(open_ or camera.open, QUICK, now_s=time.monotonic, kernel_stamps=True, **further)


@pytest.fixture
def device(camera: FakeCamera) -> Iterator[Device]:
    device = device_of(camera)
    yield device
    camera.unplug()
    device.close()


def next_frame(device: Device) -> Frame:
    frames: list[Frame] = []

    def came() -> bool:
        frame = device.read(timeout_s=0.05)
        frames.extend([frame] if frame is not None else [])
        return bool(frames)

    assert until(came, patience_s=PATIENCE_S), device.trouble
    return frames[0]


def test_a_frame_is_handed_out_once(camera: FakeCamera, device: Device) -> None:
    camera.give(3)
    assert number_of(next_frame(device).image) == 3
    assert device.read(timeout_s=0.01) is None


def test_of_several_frames_the_newest_is_handed_out(camera: FakeCamera, device: Device) -> None:
    for number in range(5):
        camera.give(number)
    frame = None

    def newest() -> bool:
        nonlocal frame
        frame = device.read(timeout_s=0.05) or frame
        return frame is not None and number_of(frame.image) == 4

    assert until(newest, patience_s=PATIENCE_S)


def test_a_frame_carries_the_stamp_of_the_kernel(camera: FakeCamera, device: Device) -> None:
    exposed_s = time.monotonic() - 0.02
    camera.give(1, kernel_s=exposed_s)
    assert next_frame(device).t_s == pytest.approx(exposed_s, abs=2e-3)
    assert ("stamped_by", "kernel") in device.values()


def test_a_camera_that_is_unplugged_and_plugged_in_continues(camera: FakeCamera, device: Device) -> None:
    camera.give(1)
    next_frame(device)
    camera.unplug()
    assert until(lambda: "no such device" in device.trouble, patience_s=PATIENCE_S)
    assert device.read(timeout_s=0.0) is None
    camera.plug_in()
    camera.give(7)
    assert number_of(next_frame(device).image) == 7
    assert device.trouble == "" and ("reopened", "1") in device.values()


@pytest.mark.parametrize("call", ["grab", "retrieve", "release"])
def test_a_device_that_raises_is_opened_again_and_the_error_reported(
    camera: FakeCamera, device: Device, call: str
) -> None:
    def fail() -> None:
        raise MemoryError

    camera.give(1)
    next_frame(device)
    setattr(camera.handles[0], call, fail)
    camera.give(2)
    if call == "release":
        camera.handles[0].grab = lambda: False  # type: ignore[method-assign]
    reports: list[str] = []

    def opened_again() -> bool:
        device.read(timeout_s=0.01)
        reports.append(device.trouble)
        return len(camera.handles) == 2

    assert until(opened_again, patience_s=PATIENCE_S)
    assert "MemoryError" in reports
    camera.give(7)
    assert until(lambda: number_of(next_frame(device).image) == 7, patience_s=PATIENCE_S)
    assert device.trouble == "" and ("reopened", "1") in device.values()


def test_the_handle_of_an_unplugged_camera_is_released(camera: FakeCamera, device: Device) -> None:
    camera.unplug()
    assert until(lambda: camera.handles[0].released, patience_s=PATIENCE_S)


def test_a_read_that_hangs_is_reported_and_the_device_opened_again(
    camera: FakeCamera, device: Device
) -> None:
    camera.hang()
    reports: list[str] = []

    def opened_again() -> bool:
        assert device.read(timeout_s=0.02) is None  # and returns
        reports.append(device.trouble)
        return len(camera.handles) == 2

    assert until(opened_again, patience_s=PATIENCE_S)
    assert "does not answer" in reports[-1]
    camera.give(5)
    assert number_of(next_frame(device).image) == 5
    assert device.trouble == "" and ("hung", "1") in device.values()


def test_a_release_that_hangs_does_not_keep_the_camera_from_coming_back(
    camera: FakeCamera, device: Device
) -> None:
    entered, free = threading.Event(), threading.Event()
    camera.handles[0].release = lambda: (entered.set(), free.wait(60))  # type: ignore[method-assign]
    camera.unplug()
    assert entered.wait(PATIENCE_S)
    camera.plug_in()
    assert until(lambda: device.read(timeout_s=0.02) or len(camera.handles) == 2, patience_s=PATIENCE_S)
    free.set()


def test_a_call_that_returns_after_it_was_given_up_yields_no_frame(
    camera: FakeCamera, device: Device
) -> None:
    camera.hang()
    assert until(lambda: device.read(timeout_s=0.02) or len(camera.handles) == 2, patience_s=PATIENCE_S)
    camera.recover()
    assert until(lambda: camera.handles[0].released, patience_s=PATIENCE_S)
    assert device.read(timeout_s=0.0) is None
    camera.give(2)
    assert number_of(next_frame(device).image) == 2


def test_a_device_that_always_hangs_occupies_few_threads(camera: FakeCamera, device: Device) -> None:
    def hang_again() -> bool:
        camera.hang()
        device.read(timeout_s=0.02)
        return ("hung", str(MAX_HANGING)) in device.values()

    assert until(hang_again, patience_s=PATIENCE_S)
    until(lambda: hang_again() and False, patience_s=1.0)
    assert len(camera.handles) == MAX_HANGING + 1


def test_a_device_that_cannot_be_opened_is_refused_with_the_reason(camera: FakeCamera) -> None:
    camera.unplug()
    with pytest.raises(InputError, match="/dev/video0: no such device"):
        device_of(camera)


def test_a_device_whose_opening_hangs_is_refused() -> None:
    camera = FakeCamera()
    with pytest.raises(InputError, match=r"does not answer within 0\.1 s"):
        device_of(camera, lambda: time.sleep(1.0), open_s=0.1)
