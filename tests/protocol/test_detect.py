"""What bytes without a MAVLink message are called."""

import binascii
import random
import struct
from pathlib import Path

import pytest

from server.link.base import LinkState
from server.protocol.detect import MIN_BYTES, detect
from server.protocol.mavlink import MavlinkProtocol
from server.protocol.signatures import MAX_FAILED, _framed, crc8_dvb_s2, crc24q
from tests.protocol.peer import frame_list

CAPTURES = {
    "mtk-3301.log": "NMEA 0183",
    "nmea-fuzzy-cases.log": "NMEA 0183",
    "quectel-l76k-nmea.log": "NMEA 0183",
    "ublox-8.log": "NMEA 0183",
    "ublox-neo-m8l.log": "u-blox UBX",
    "ublox-neo-m8n.log": "u-blox UBX",
    "ublox-zed-f9r.log": "u-blox UBX",
}


def captured(path: Path) -> bytes:
    """The receiver's bytes behind the lines of comment."""
    data = path.read_bytes()
    while data.startswith(b"#"):
        data = data.split(b"\n", 1)[1]
    return data


def as_heard_at(data: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """What a UART (8N1) at another rate makes of bytes sent back to back."""
    levels = [1] * 20
    for byte in data:
        levels += [0, *((byte >> k) & 1 for k in range(8)), 1]
    heard, at, step = [], 0.0, sent_baud / heard_baud
    while at + 10 * step < len(levels):
        if levels[int(at)]:
            at += 0.1
            continue
        heard.append(sum(levels[int(at + (1.5 + k) * step)] << k for k in range(8)))
        at += 9.5 * step
        while at < len(levels) and not levels[int(at)]:  # a missing stop bit: wait for the line to rise
            at += 0.1
    return bytes(heard)


@pytest.mark.parametrize(("name", "protocol"), CAPTURES.items())
def test_a_receivers_capture_is_named(shared_data: Path, name: str, protocol: str) -> None:
    data = captured(shared_data / "gpsd_captures" / name)
    for start in range(0, max(len(data) - 4096, 1), max(len(data) // 5, 1)):
        found = detect(data[start : start + 4096])
        assert found is not None
        assert (found.state, found.code) == (LinkState.FOREIGN_PROTOCOL, "foreign-protocol")
        assert found.protocol == protocol
        assert found.cause == f"The bytes are {found.protocol}, not MAVLink."


@pytest.mark.parametrize("sent", [57600, 115200, 460800, 921600, 1_500_000])
@pytest.mark.parametrize("heard", [38400, 57600, 115200, 230400, 921600, 1_500_000])
def test_mavlink_at_another_rate_is_a_wrong_baud_rate(shared_data: Path, sent: int, heard: int) -> None:
    if sent == heard:
        return
    frames = frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")
    data = as_heard_at(b"".join(frames[:300] if sent <= heard else frames[:3000])[:40_000], sent, heard)
    found = detect(data[-4096:], baud=heard)
    assert found is not None
    assert (found.state, found.protocol) == (LinkState.WRONG_BAUD, "")
    assert found.code in {"wrong-baud", "line-stuck"}


def test_the_resampling_of_this_test_is_the_identity_at_the_right_rate() -> None:
    data = bytes(range(256))
    assert as_heard_at(data + b"\0\0", 57600, 57600).startswith(data)


def test_noise_is_never_taken_for_a_protocol() -> None:
    generator = random.Random(1)
    for _ in range(40):
        found = detect(generator.randbytes(4096))
        assert found is not None
        assert found.code == "wrong-baud"


def msp_frame(command: int, payload: bytes) -> bytes:
    body = bytes((len(payload), command)) + payload
    check = 0
    for byte in body:
        check ^= byte
    return b"$M>" + body + bytes((check,))


def test_msp_is_named() -> None:
    data = b"".join(msp_frame(102, struct.pack("<9h", *range(k, k + 9))) for k in range(40))
    found = detect(data)
    assert found is not None
    assert found.protocol == "MSP (Betaflight, INAV)"
    assert "MAVLink" in found.remedy


def crc8(data: bytes) -> int:
    """CRC-8/DVB-S2 bit by bit."""
    crc = 0
    for byte in data:
        for bit in range(7, -1, -1):
            feedback = (crc >> 7) ^ ((byte >> bit) & 1)
            crc = ((crc << 1) & 0xFF) ^ (0xD5 if feedback else 0)
    return crc


def test_msp_2_is_named() -> None:
    body = bytes.fromhex("006400120048656c6c6f20666c79696e6720776f726c64")
    frame = b"$X>" + body + bytes((crc8(body),))
    found = detect(frame * 30)
    assert found is not None
    assert found.protocol == "MSP (Betaflight, INAV)"


def test_crsf_is_named() -> None:
    body = bytes.fromhex("1410101064000001020964")  # link statistics
    found = detect((bytes((0xC8, len(body) + 1)) + body + bytes((crc8(body),))) * 60)
    assert found is not None
    assert found.protocol == "CRSF (radio control link)"


def test_check_sums_have_the_catalogues_check_values() -> None:
    assert crc8_dvb_s2(b"123456789") == 0xBC
    assert crc24q(b"123456789") == 0xCDE703


def test_septentrio_and_rtcm_are_named() -> None:
    payload = bytes(range(52))
    body = (4007).to_bytes(2, "little") + (60).to_bytes(2, "little") + payload
    sbf_frame = b"$@" + binascii.crc_hqx(body, 0).to_bytes(2, "little") + body
    rtcm_head = b"\xd3\x00\x13" + bytes(range(19))
    rtcm_frame = rtcm_head + crc24q(rtcm_head).to_bytes(3, "big")
    for frame, name in ((sbf_frame, "Septentrio SBF"), (rtcm_frame, "RTCM 3")):
        found = detect(frame * 40)
        assert found is not None
        assert found.protocol == name


def test_a_console_is_plain_text_and_quoted() -> None:
    found = detect(b"\r\nnsh> \r\nINFO  [logger] logger started (mode=all)\r\n" * 20)
    assert found is not None
    assert found.protocol == "plain text"
    assert "logger started" in found.remedy


@pytest.mark.parametrize("level", [b"\0", b"\xff"])
def test_a_line_at_one_level_is_told_apart(level: bytes) -> None:
    found = detect(level * 1000)
    assert found is not None
    assert found.code == "line-stuck"


def test_hostile_bytes_stop_the_search_early() -> None:
    data = b"\xd3\x03\xff" * 1365
    tried = []
    assert _framed(data, b"\xd3", lambda _: 1000, lambda frame: bool(tried.append(frame))) == 0
    assert len(tried) <= MAX_FAILED


def test_a_few_bytes_say_nothing() -> None:
    assert detect(b"$GP" * 20) is None
    assert MIN_BYTES > 60


@pytest.mark.parametrize(("sent", "heard"), [(921600, 115200), (57600, 115200), (115200, 57600), (115200, 921600)])
def test_a_wrong_baud_rate_makes_no_frames_to_be_counted(shared_data: Path, sent: int, heard: int) -> None:
    """Noise does make unknown ids, about one in 2 kB, because they have no check sum: they are no sign of a board."""
    frames = frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")
    protocol = MavlinkProtocol(talk=False)
    protocol.feed(as_heard_at(b"".join(frames[:4000])[:150_000], sent, heard), 0)
    stats = protocol.stats
    assert stats.frames == 0
    assert stats.senders == ()
    assert stats.bytes_in == stats.bytes_frames + stats.bytes_junk + stats.bytes_pending
