"""A DBC is judged by the messages that a map uses; faults in its other parts change nothing."""

from pathlib import Path

import can_rig
import cantools
import opendbc
import pytest

from trepid.config import InputError
from vehicle.actuators.can.dbc import Dbc

UNUSED = {
    "two signals overlap": 'BO_ 900 SEATS: 8 CAR\n SG_ FRONT : 0|8@1+ (1,0) [0|255] "" X\n'
    ' SG_ REAR : 4|8@1+ (1,0) [0|255] "" X\n',
    "a signal is longer than its message": 'BO_ 900 SEATS: 2 CAR\n SG_ FRONT : 12|8@1+ (1,0) [0|255] "" X\n',
    "an identifier is hexadecimal": 'BO_ 0x384 SEATS: 8 CAR\n SG_ STEER_ANGLE : 0|8@1+ (1,0) [0|255] "" X\n',
    "an identifier lacks bit 31": 'BO_ 13274 SEATS: 8 CAR\n SG_ FRONT : 0|8@1+ (1,0) [0|255] "" X\n',
    "a signal's name begins with a digit": 'BO_ 900 SEATS: 8 CAR\n SG_ 2FRONT : 0|8@1+ (1,0) [0|255] "" X\n',
    "a message's name begins with a digit": 'BO_ 900 2SEATS: 8 CAR\n SG_ FRONT : 0|8@1+ (1,0) [0|255] "" X\n',
    "a scale is missing": 'BO_ 900 SEATS: 8 CAR\n SG_ FRONT : 0|8@1+ (,0) [0|255] "" X\n',
    "a unit is not closed": 'BO_ 900 SEATS: 8 CAR\n SG_ FRONT : 0|8@1+ (1,0) [0|255] "deg X\n',
    "values of a message that is not there": 'VAL_ 501 STATE 1 "on" 0 "off" ;\n',
    "values of a signal that is not there": 'VAL_ 401 STATE 1 "on" 0 "off" ;\n',
    "a comment has no message": 'CM_ 145 "seats";\n',
    "an attribute is not defined": 'BA_ "GenMsgCycleTime" BO_ 401 10;\n',
    "two messages have one name": "BO_ 900 SEATS: 8 CAR\n\nBO_ 901 SEATS: 8 CAR\n",
    "a comment that looks like a message": 'CM_ BO_ 401 "before\nBO_ 401 STEERING_LTA: 4 CAR\nafter";\n',
}


def with_text(folder: Path, text: str, **changes: str) -> Path:
    """The map of the shuttle, with ``text`` at the end of its DBC and ``changes`` in its text."""
    path = can_rig.copy_map(folder)
    dbc = folder / "shuttle.dbc"
    whole = dbc.read_text() + text
    for old, new in changes.items():
        assert old in whole
        whole = whole.replace(old, new, 1)
    dbc.write_text(whole)
    return path


def line_of(dbc: Path, start: str) -> int:
    return next(k for k, line in enumerate(dbc.read_text().splitlines(), 1) if line.strip().startswith(start))


@pytest.mark.parametrize("fault", UNUSED)
def test_a_fault_that_no_mapped_signal_touches_changes_no_byte(tmp_path, fault):
    signals = can_rig.load_map(with_text(tmp_path, UNUSED[fault]), can_rig.VEHICLE)
    quantities = can_rig.command_quantities(can_rig.command(angle_rad=0.1, accel_mps2=-1.0))
    for ours, shipped in zip(signals.senders(), can_rig.SHUTTLE.senders(), strict=True):
        assert (ours.address, ours.extended) == (shipped.address, shipped.extended)
        assert ours.frame(quantities) == shipped.frame(quantities)


def test_signals_of_a_mapped_message_that_are_not_mapped_may_overlap(tmp_path):
    more = ' SG_ A : 63|4@0+ (1,0) [0|15] "" X\n SG_ B : 61|4@0+ (1,0) [0|15] "" X\n'
    before = ' SG_ YAW_RATE : 1|10@0+ (0.244,-125) [-125|124.6] "deg/s" TREPID\n'
    path = with_text(tmp_path, "", **{before: before + more})
    receiver = next(
        each for each in can_rig.load_map(path, can_rig.VEHICLE).receivers() if each.address == 36
    )
    assert receiver.quantities(bytes([0x02, 0x00, *[0xFF] * 6]))["yaw_rate_radps"] == pytest.approx(
        (512 * 0.244 - 125) / 57.29578
    )


MAPPED = {
    "overlap": (
        {"SPEED : 47|16@0+": "SPEED : 55|16@0+"},
        "SG_ SPEED",
        "signals SPEED and CHECKSUM of message SPEED overlap, first in bit 0 of byte 7",
    ),
    "overlap with a signal that is not mapped": (
        {"BO_ 36 KINEMATICS: 8 CAR\n": 'BO_ 36 KINEMATICS: 8 CAR\n SG_ X : 15|1@0+ (1,0) [0|1] "" CAR\n'},
        "SG_ YAW_RATE",
        "signals YAW_RATE and X of message KINEMATICS overlap, first in bit 7 of byte 1",
    ),
    "length": (
        {"BO_ 36 KINEMATICS: 8": "BO_ 36 KINEMATICS: 1"},
        "BO_ 36",
        "The signal YAW_RATE does not fit in message KINEMATICS.",
    ),
    "identifier": (
        {"BO_ 36 KINEMATICS": "BO_ 13274 KINEMATICS"},
        "BO_ 13274",
        "the identifier 13274 of message KINEMATICS has more than 11 bits without bit 31; "
        "as an extended frame it is 2147496922",
    ),
    "syntax": ({"(0.244,-125)": "(0.244;-125)"}, "SG_ YAW_RATE", "message KINEMATICS: wrong syntax of a DBC"),
    "float": (
        {"VAL_ 36": "SIG_VALTYPE_ 36 YAW_RATE : 1;\nVAL_ 36"},
        "SG_ YAW_RATE",
        "signal YAW_RATE is a float (SIG_VALTYPE_) of 10 bits: expected 32 or 64",
    ),
    "factor": (
        {"(0.244,-125)": "(0,-125)"},
        "SG_ YAW_RATE",
        "signal YAW_RATE has the factor 0, and so the same value for all bits",
    ),
    "signal twice": (
        {
            "BO_ 36 KINEMATICS: 8 CAR\n": 'BO_ 36 KINEMATICS: 8 CAR\n SG_ YAW_RATE : 40|1@0+ (1,0) [0|1] "" X\n'
        },
        "SG_ YAW_RATE : 1|",
        "message KINEMATICS has signal YAW_RATE twice",
    ),
    "message twice": (
        {
            "BO_ 180 SPEED": 'BO_ 37 KINEMATICS: 8 CAR\n SG_ YAW_RATE : 1|10@0+ (1,0) [0|1] "" X\n\nBO_ 180 SPEED'
        },
        "BO_ 37",
        "message KINEMATICS is there already in line",
    ),
}


@pytest.mark.parametrize(
    ("written", "nodes"),
    [
        ('"deg/s" TREPID', '"deg/s"'),
        ('"deg/s" TREPID', '"deg/s" A-1,  B'),
        ("KINEMATICS: 8 CAR", "KINEMATICS: 8"),
    ],
)
def test_a_mapped_message_is_read_whoever_sends_or_gets_it(tmp_path, written, nodes):
    path = with_text(tmp_path, "", **{written: nodes})
    yaw = can_rig.load_map(path, can_rig.VEHICLE).messages["KINEMATICS"].get_signal_by_name("YAW_RATE")
    assert (yaw.start, yaw.length, yaw.scale, yaw.offset, yaw.unit) == (1, 10, 0.244, -125, "deg/s")


@pytest.mark.parametrize("fault", MAPPED)
def test_a_fault_of_a_mapped_signal_is_refused_with_its_line_in_the_dbc(tmp_path, fault):
    changes, place, message = MAPPED[fault]
    path = with_text(tmp_path, "", **changes)
    with pytest.raises(InputError) as refused:
        can_rig.load_map(path, can_rig.VEHICLE)
    dbc = tmp_path / "shuttle.dbc"
    assert str(refused.value).startswith(f"{dbc}:{line_of(dbc, place)}:")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_a_dbc_is_read_in_the_encodings_of_its_editors(tmp_path, encoding):
    path = with_text(tmp_path, 'CM_ BO_ 36 "Gierrate über das Steuergerät";\n')
    dbc = tmp_path / "shuttle.dbc"
    dbc.write_bytes(dbc.read_text().replace("deg/s", "°/s").encode(encoding))
    message = can_rig.load_map(path, can_rig.VEHICLE).messages["KINEMATICS"]
    assert message.get_signal_by_name("YAW_RATE").unit == "°/s"


@pytest.mark.parametrize("stated", ["SIG_VALTYPE_ 36 S : 1;\n", "SIG_VALTYPE_ 36 S 1;\n"])
def test_a_float_is_one_with_and_without_the_colon_of_its_statement(tmp_path, stated):
    dbc = tmp_path / "float.dbc"
    dbc.write_text(f'BO_ 36 M: 8 X\n SG_ S : 0|32@1- (1,0) [0|0] "km/h" X\n\n{stated}')
    assert Dbc(dbc).message("M", {"S"}).signals[0].is_float


def test_the_name_of_a_frame_format_means_its_number(tmp_path):
    dbc = tmp_path / "format.dbc"
    formats = 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD";\n'
    stated = 'BA_ "VFrameFormat" BO_ 36 "StandardCAN_FD";\n'
    dbc.write_text(f'BO_ 36 M: 64 X\n SG_ S : 400|8@1+ (1,0) [0|0] "" X\n\n{formats}{stated}')
    assert Dbc(dbc).message("M", {"S"}).is_fd


VALUES_OF_S = {
    "with decimal points": 'VAL_ 36 S 65535.0 "SNA" 65534. "Error" 0.00 "standstill";\n',
    "with hexadecimal values": 'VAL_ 36 S 0xFFFF "SNA" 0Xfffe "Error" 0x0 "standstill";\n',
    "of a table with hexadecimal and decimal points": (
        'VAL_TABLE_ Vt 0xFFFF "SNA" 65534.0 "Error" 0 "standstill";\nVAL_ 36 S Vt;\n'
    ),
    "in one statement": 'VAL_ 36 S 65535 "SNA" 65534 "Error" 0 "standstill";\n',
    "in two statements": 'VAL_ 36 S 65535 "SNA" 65534 "Error";\nVAL_ 36 S 0 "standstill";\n',
    "in two statements over three lines": 'VAL_ 36 S 65535 "SNA"\n  65534 "Error" ;\nVAL_ 36 S 0 "standstill" ;\n',
    "of a table": 'VAL_TABLE_ Vt 65535 "SNA" 65534 "Error" 0 "standstill";\nVAL_ 36 S Vt ;\n',
    "of a table behind them": 'VAL_ 36 S Vt;\nVAL_TABLE_ Vt 65535 "SNA" 65534 "Error" 0 "standstill" ;\n',
}


@pytest.mark.parametrize("values", VALUES_OF_S.values(), ids=VALUES_OF_S)
def test_no_named_value_is_lost_however_a_file_states_them(tmp_path, values):
    dbc = tmp_path / "speed.dbc"
    dbc.write_text(f'BO_ 36 M: 8 X\n SG_ S : 0|16@1+ (0.01,0) [0|0] "km/h" X\n\n{values}')
    choices = Dbc(dbc).message("M", {"S"}).signals[0].choices
    assert {raw: str(name) for raw, name in choices.items()} == {
        65535: "SNA",
        65534: "Error",
        0: "standstill",
    }


@pytest.mark.parametrize(
    ("attributes", "protocol"),
    [
        ('BA_DEF_ "ProtocolType" STRING;\nBA_ "ProtocolType" "J1939";\n', "j1939"),
        ('BA_DEF_ "ProtocolType" STRING;\nBA_DEF_DEF_ "ProtocolType" "J1939";\n', "j1939"),
        ('BA_DEF_ "ProtocolType" STRING;\nBA_ "ProtocolType" "OBD";\n', None),
        ("", None),
    ],
)
def test_extended_frames_of_a_network_of_j1939_are_of_j1939(tmp_path, attributes, protocol):
    dbc = tmp_path / "truck.dbc"
    frame = 'BO_ {} {}: 8 X\n SG_ S : 0|16@1+ (0.01,0) [0|0] "km/h" X\n\n'
    dbc.write_text(frame.format(2566844926, "WHEELS") + frame.format(36, "OWN") + attributes)
    read = Dbc(dbc)
    assert [read.message(name, {"S"}).protocol for name in ("WHEELS", "OWN")] == [protocol, None]


def test_long_names_are_the_names_of_messages_and_signals(tmp_path):
    dbc = tmp_path / "long.dbc"
    dbc.write_text(
        'BO_ 5 M_0000: 8 X\n SG_ S_0000 : 0|8@1+ (1,0) [0|255] "" X\n\n'
        'BA_DEF_ BO_ "SystemMessageLongSymbol" STRING ;\nBA_DEF_ SG_ "SystemSignalLongSymbol" STRING ;\n'
        'BA_DEF_DEF_ "SystemMessageLongSymbol" "";\nBA_DEF_DEF_ "SystemSignalLongSymbol" "";\n'
        'BA_ "SystemMessageLongSymbol" BO_ 5 "SpeedOfTheCar";\n'
        'BA_ "SystemSignalLongSymbol" SG_ 5 S_0000 "SpeedOfTheFrontAxle";\n'
    )
    read = Dbc(dbc)
    assert (set(read.messages), read.signals("SpeedOfTheCar")) == ({"SpeedOfTheCar"}, ["SpeedOfTheFrontAxle"])
    message = read.message("SpeedOfTheCar", {"SpeedOfTheFrontAxle"})
    assert (message.name, message.signals[0].name) == ("SpeedOfTheCar", "SpeedOfTheFrontAxle")


def test_a_selector_without_its_capital_is_a_signal_and_the_signals_of_no_message_make_none(tmp_path):
    """As in vw_pq.dbc and FORD_CADS.dbc of opendbc."""
    dbc = tmp_path / "odd.dbc"
    dbc.write_text(
        'BO_ 1073741824 VECTOR__INDEPENDENT_SIG_MSG: 0 X\n SG_ LOST : 0|8@1+ (1,0) [0|0] "" X\n\n'
        'BO_ 5 PARTS: 8 X\n SG_ CODE m : 6|2@1+ (1,0) [0|3] "" X\n SG_ GEAR m2 : 0|6@1+ (1,0) [0|63] "" X\n'
    )
    read = Dbc(dbc)
    assert (set(read.messages), read.signals("PARTS")) == ({"PARTS"}, ["CODE", "GEAR"])
    (code,) = read.message("PARTS", {"CODE"}).signals
    assert (code.start, code.length) == (6, 2)
    with pytest.raises(InputError, match=r"odd\.dbc:6:1: signal GEAR .* is multiplexed by 0 selectors"):
        read.selector("PARTS", {"GEAR"})


def facts(message):
    signals = sorted(message.signals, key=lambda signal: signal.name)
    layout = [(s.name, s.start, s.length, s.byte_order, s.is_signed, s.is_float) for s in signals]
    values = [(s.scale, s.offset, s.minimum, s.maximum, s.unit, str(s.choices)) for s in signals]
    head = (message.name, message.frame_id, message.is_extended_frame, message.length, message.is_fd)
    return (*head, message.protocol, layout, values)


@pytest.mark.parametrize("name", ["mercedes_benz_e350_2010", "toyota_tss2_adas", "ford_lincoln_base_pt"])
def test_a_message_alone_is_the_message_of_the_whole_file(name):
    file = Path(opendbc.__file__).parent / "dbc" / f"{name}.dbc"
    whole = cantools.database.load_file(file, database_format="dbc", strict=True).messages
    read = Dbc(file)
    assert {message.name for message in whole} == set(read.messages)
    for message in whole[:40]:
        if not message.is_multiplexed():
            assert facts(read.message(message.name, set(read.signals(message.name)))) == facts(message)


def test_every_file_of_opendbc_that_cantools_refuses_for_an_overlap_has_messages_that_load():
    folder = Path(opendbc.__file__).parent / "dbc"
    for name, message in {
        "vw_pq": "Kombi_1",
        "hyundai_i30_2014": "WHL_SPD",
        "volvo_v40_2017_pt": "VehicleSpeed1",
    }.items():
        read = Dbc(folder / f"{name}.dbc")
        assert read.message(message, set(read.signals(message))).name == message
