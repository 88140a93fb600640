"""Messages survive CDR exactly, absence stays absence, and foreign bytes are refused."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from trepid import messages as m
from trepid.clock import nanoseconds, seconds
from trepid.wire import COMMAND_FIELDS, DERIVED, STORE, WireError, from_cdr, msg_text, ros_name, to_cdr

finite = st.floats(allow_nan=False, allow_infinity=False)
stamps = st.integers(1, 2**30 * 10**9).map(seconds)
PLAIN = {
    float: finite,
    float | None: st.none() | finite,
    int: st.integers(-(2**31), 2**31 - 1),
    bool: st.booleans(),
    bool | None: st.none() | st.booleans(),
    str: st.text(st.characters(min_codepoint=1, codec="utf-8"), max_size=8),
    m.Mode: st.sampled_from(m.Mode),
    m.Stop: st.sampled_from(m.Stop),
    m.Limit: st.sampled_from(m.Limit),
    m.EstimateKind: st.sampled_from(m.EstimateKind),
    tuple[float, ...]: st.lists(finite, max_size=3).map(tuple),
    tuple[float | None, ...]: st.lists(st.none() | finite, max_size=3).map(tuple),
    tuple[str, ...]: st.lists(st.text("abc", max_size=3), max_size=3).map(tuple),
    m.PixelPath: st.lists(st.tuples(finite, finite), max_size=3).map(tuple),
}


def instances(message_type: type) -> st.SearchStrategy:
    return st.builds(
        message_type,
        **{
            field.name: (st.none() | stamps if field.type == float | None else stamps)
            if field.name == "t_s"
            else PLAIN[field.type]
            for field in dataclasses.fields(message_type)
        },
    )


@pytest.mark.parametrize("message_type", DERIVED)
def test_every_derived_message_survives_the_wire_exactly(message_type: type) -> None:
    @settings(max_examples=30)
    @given(instances(message_type))
    def round_trip(message: m.Message) -> None:
        assert from_cdr(to_cdr(message), message_type) == message

    round_trip()


DRIVE = "ackermann_msgs/msg/AckermannDrive"
DEFINITIONS = {ros_name(one): msg_text(one) for one in DERIVED} | {
    DRIVE: "".join(f"float32 {name}\n" for name in COMMAND_FIELDS),
    ros_name(m.Command): "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
}


@pytest.mark.parametrize("name", DEFINITIONS)
def test_the_fields_of_a_type_are_those_of_its_definition(name: str) -> None:
    assert STORE.fielddefs[name] == get_types_from_msg(DEFINITIONS[name], name)[name]


def test_a_frame_survives_the_wire_bit_for_bit() -> None:
    image = np.random.default_rng(1).integers(0, 256, (24, 32, 3), np.uint8)
    frame = from_cdr(to_cdr(m.Frame(t_s=12.25, image=image)), m.Frame)
    assert frame.t_s == 12.25
    assert np.array_equal(frame.image, image)


def test_a_command_survives_at_the_float32_of_ackermann_msgs() -> None:
    command = m.Command(
        t_s=None, road_wheel_angle_rad=0.125, road_wheel_rate_radps=0, speed_mps=5, accel_mps2=-1, jerk_mps3=0
    )
    assert from_cdr(to_cdr(command), m.Command) == command


def test_a_diagnostic_survives_the_wire() -> None:
    diagnostic = m.Diagnostic(
        t_s=1.5, process="cv", health=m.Health.WARN, message="late", values=(("rate_hz", "25.0"),)
    )
    assert from_cdr(to_cdr(diagnostic), m.Diagnostic) == diagnostic


@given(st.binary(max_size=64), st.sampled_from([*DERIVED, m.Frame, m.Command, m.Diagnostic]))
def test_foreign_bytes_are_refused_not_misread(data: bytes, message_type: type) -> None:
    try:
        from_cdr(data, message_type)
    except WireError:
        return
    assert len(data) > 4  # only bytes that really spell the message may pass


def test_a_message_cut_short_is_refused() -> None:
    state = m.VehicleState(
        t_s=1.0, speed_mps=1.0, road_wheel_angle_rad=None, yaw_rate_radps=0.0, driver_override=False
    )
    with pytest.raises(WireError):
        from_cdr(to_cdr(state)[:-9], m.VehicleState)


@given(st.integers(0, 2**53))
def test_stamps_survive_the_round_trip_to_nanoseconds(stamp_ns: int) -> None:
    assert seconds(nanoseconds(seconds(stamp_ns))) == seconds(stamp_ns)


def test_the_msg_text_states_units_signs_and_the_header() -> None:
    text = msg_text(m.VehicleState)
    assert "std_msgs/Header header" in text
    assert "float64 speed_mps" in text
    assert "ISO 8855" in text


def test_a_message_longer_than_any_of_its_type_is_refused_before_it_is_decoded() -> None:
    decision = to_cdr(
        m.Diagnostic(t_s=1.0, process="cv", health=m.Health.OK, message="x" * 300_000, values=())
    )
    with pytest.raises(WireError, match="too many"):
        from_cdr(decision, m.Diagnostic)


@pytest.mark.parametrize(
    ("message", "frame_id"),
    [
        (m.Frame(t_s=2.5, image=np.zeros((2, 2, 3), np.uint8)), "camera_optical"),
        (m.Command(t_s=2.5, road_wheel_angle_rad=0.0, speed_mps=0.0, accel_mps2=0.0), "rear_axle"),
        (m.Command(t_s=None, road_wheel_angle_rad=0.0, speed_mps=0.0, accel_mps2=0.0), "rear_axle"),
    ],
)
def test_a_header_names_the_frame_of_the_data_and_the_capture_of_the_frame_or_zero_without_one(
    message: m.Frame | m.Command, frame_id: str
) -> None:
    header = STORE.deserialize_cdr(to_cdr(message), ros_name(type(message))).header
    assert header.frame_id == frame_id
    assert (header.stamp.sec, header.stamp.nanosec) == ((2, 500_000_000) if message.t_s else (0, 0))
