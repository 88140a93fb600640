"""Values of CAN signals that are no measurement, by DBCs of all three ways to say so."""

import can_rig
import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.actuators.can.invalid import InvalidValues, is_invalid_name

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: CAR TREPID\n'


def signal(line, values="", *, extended=False):
    """The only signal of a DBC, and the protocol of its message."""
    address = 2566834709 if extended else 36
    text = f"{HEAD}BO_ {address} M: 8 CAR\n SG_ S : {line} TREPID\n"
    text += f"VAL_ {address} S {values};\n" if values else ""
    if extended:
        text += 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
        text += f'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\nBA_ "VFrameFormat" BO_ {address} 3;\n'
    message = cantools.database.load_string(text, "dbc").messages[0]
    return message.signals[0], message.protocol


@pytest.mark.parametrize(
    "name",
    [
        *(
            "SNA",
            "Signal not available",
            "sna_value",
            "SignalNotAvailable",
            "NOT_AVAILABLE",
            "Not valid",
            "N/A",
        ),
        *("Invalid", "INVALID_DATA", "Error", "ERR", "sensor error", "Fault", "Faulty", "FAILURE", "Unknown"),
        *("NoData", "NoDataExists", "No signal", "Undefined", "Init", "Initializing", "not initialized"),
        *("Reserved", "Unavailable", "Fehler", "ungueltig", "Not_Defined", "Implausible", "SNA 2"),
        *("Signal nicht verfügbar", "Ungültig", "ungu\u0308ltig", "Initialisierung", "nicht gültig", "NaN"),
        *(
            "Non disponible",
            "Indisponible",
            "Valeur erronée",
            "inconnu",
            "niet beschikbaar",
            "ej tillgänglig",
        ),
        *(
            "no value",
            "No Measurement",
            "kein Wert",
            "keine Daten",
            "unbekannt",
            "Störung",
            "Ausfall",
            "n.v.",
        ),
        *("SIG_NOT_AVL", "Timeout", "lost_comm", "Out_Of_Range", "overflow", "uncalibrated", "missing"),
        *("无效", "無効", "不可用"),
    ],
)
def test_names_that_real_files_give_to_values_without_a_measurement_are_recognised(name):
    assert is_invalid_name(name)


@pytest.mark.parametrize(
    "name",
    [
        *(
            "Left",
            "no error",
            "NO_FAULT",
            "NoError",
            "not faulty",
            "valid",
            "Available",
            "initialized",
            "Standstill",
        ),
        *("0 km/h", "Forward", "Nav", "Ferry", "interrupted", "default", "terrain", "finite", "no_override"),
        *("gültig", "verfügbar", "kein Fehler", "disponible", "no_timeout", "keine Störung", "no override"),
    ],
)
def test_names_of_measured_values_are_not_taken_for_invalid_ones(name):
    assert not is_invalid_name(name)


def test_a_value_named_by_its_bits_is_that_of_a_signal_with_a_sign():
    check = InvalidValues(
        *signal('0|16@1- (0.1,0) [-3276.8|3276.7] "deg"', '65535 "SNA" 32768 "Error"'), also=[65534]
    )
    assert [check.reason(raw) for raw in (-1, -2, -32768)] == [
        '-1 is "SNA"',
        "-2 is invalid by the map",
        '-32768 is "Error"',
    ]
    assert [check.reason(raw) for raw in (1, -3, 32767)] == ["", "", ""]


def test_a_named_value_is_no_measurement_and_the_reason_gives_value_and_name():
    check = InvalidValues(*signal('1|10@0+ (0.244,-125) [-125|124.6] "deg/s"', '1023 "SNA" 512 "Straight"'))
    assert check.reason(1023) == '1023 is "SNA"'
    assert check.reason(512) == ""
    assert check.reason(1022) == ""


@pytest.mark.parametrize(
    ("definition", "stated"),
    [
        ("STRING", '"FFFEh"'),
        ("STRING", '"0xFFFE"'),
        ("STRING", '"65534"'),
        ("INT 0 65535", "65534"),
        ("HEX 0 65535", "65534"),
        ("FLOAT 0 65535", "65534.0"),
    ],
)
@pytest.mark.parametrize("attribute", ["GenSigSNA", "GenSigInvalidValue"])
def test_the_attribute_of_a_signal_names_its_invalid_value(attribute, definition, stated):
    text = f'{HEAD}BO_ 36 M: 8 CAR\n SG_ S : 0|16@1+ (0.01,0) [0|0] "km/h" TREPID\n'
    text += f'BA_DEF_ SG_ "{attribute}" {definition};\nBA_ "{attribute}" SG_ 36 S {stated};\n'
    check = InvalidValues(cantools.database.load_string(text, "dbc").messages[0].signals[0], None)
    assert [check.reason(raw) for raw in (65533, 65534, 65535)] == ["", f'65534 is "{attribute}"', ""]
    assert check.value_to_send == 65534


@pytest.mark.parametrize("stated", ['""', '"none"', '"SNA"', '"-"'])
def test_an_attribute_without_a_number_names_no_value(stated):
    text = f'{HEAD}BO_ 36 M: 8 CAR\n SG_ S : 0|16@1+ (0.01,0) [0|0] "km/h" TREPID\n'
    text += f'BA_DEF_ SG_ "GenSigSNA" STRING;\nBA_ "GenSigSNA" SG_ 36 S {stated};\n'
    check = InvalidValues(cantools.database.load_string(text, "dbc").messages[0].signals[0], None)
    assert check.value_to_send is None


@given(raw=st.integers(0, 255))
def test_values_outside_the_stated_range_are_no_measurement_and_those_at_its_ends_are(raw):
    check = InvalidValues(*signal('0|8@1+ (1,0) [0|250] "km/h"'))
    assert (check.reason(raw) == "") == (raw <= 250)


@given(raw=st.integers(0, 255))
def test_a_range_without_extent_states_nothing(raw):
    assert InvalidValues(*signal('0|8@1+ (1,0) [0|0] ""')).reason(raw) == ""


@given(raw=st.integers(0, 0xFFFF))
def test_j1939_reserves_the_values_whose_highest_byte_is_0xfb_or_more(raw):
    check = InvalidValues(*signal('0|16@1+ (0.00390625,0) [0|0] "km/h"', extended=True))
    assert (check.reason(raw) == "") == (raw >> 8 < 0xFB)
    bits = InvalidValues(*signal('0|2@1+ (1,0) [0|0] ""', extended=True))
    assert [bits.reason(k) == "" for k in range(4)] == [True, True, False, False]


def test_the_map_may_name_further_values():
    check = InvalidValues(*signal('0|8@1+ (1,0) [0|0] ""'), {254})
    assert check.reason(254) == "254 is invalid by the map"
    assert check.reason(253) == ""


@pytest.mark.parametrize("raw", [float("nan"), float("inf")])
def test_a_float_signal_that_is_not_finite_is_no_measurement(raw):
    assert InvalidValues(*signal('0|32@1- (1,0) [0|0] ""')).reason(raw)


@pytest.fixture
def one(tmp_path):
    """A bus whose DBC names 1023 of the yaw rate, and 65535 of the speed, as not available."""
    path = can_rig.copy_map(tmp_path)
    with (tmp_path / "shuttle.dbc").open("a") as dbc:
        dbc.write('\nVAL_ 36 YAW_RATE 1023 "SNA";\nVAL_ 608 STEER_OVERRIDE 1 "Fault";\n')
    bus = can_rig.OneBus(path)
    yield bus
    bus.close()


@pytest.fixture
def senders():
    return [can_rig.SHUTTLE.sender(each) for each in can_rig.SHUTTLE.settings.reports]


def yaw_frame(raw):
    message = can_rig.SHUTTLE.messages["KINEMATICS"]
    return bytes(message.encode({"YAW_RATE": raw}, scaling=False, strict=False))


def test_an_invalid_yaw_rate_is_absent_and_doubted_at_once_and_takes_nothing_else_with_it(one, senders):
    one.report(can_rig.state(0.1, 5.0, 0.3), senders)
    one.put(36, yaw_frame(1023))
    state = one.actuator.read(now_s=0.0)
    assert state.yaw_rate_radps is None
    assert state.doubted == ("yaw_rate_radps",)
    assert state.speed_mps == pytest.approx(5.0, abs=0.01)
    assert state.road_wheel_angle_rad == pytest.approx(0.1, abs=0.001)


def test_the_heartbeat_names_message_signal_and_value_until_the_signal_is_valid_again(one, senders):
    one.report(can_rig.state(0.1, 5.0, 0.3), senders)
    one.put(36, yaw_frame(1023))
    one.actuator.read(now_s=0.0)
    assert ("invalid yaw_rate_radps", 'KINEMATICS.YAW_RATE: 1023 is "SNA"') in one.actuator.values()
    one.put(36, yaw_frame(512))
    assert one.actuator.read(now_s=0.01).yaw_rate_radps is not None
    assert one.actuator.values() == ()


def test_an_override_whose_sender_calls_it_invalid_leaves_no_state(one, senders):
    one.report(can_rig.state(0.1, 5.0, 0.3, override=True), senders)
    assert one.actuator.read(now_s=0.0) is None
    assert (
        dict(one.actuator.values())["invalid driver_override"]
        == 'STEER_TORQUE_SENSOR.STEER_OVERRIDE: 1 is "Fault"'
    )
