"""The demo board keeps MAVLink's rules: framing, sequence, and what it may be asked."""

from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from server.sim import SimSettings, SimStream
from server.sim.stream import ONLY_HEARTBEAT
from tests.sim.sim_frames import HIGHRES_IMU, MS, ask, ask_interval, by_type, decoded, sent


def test_pymavlink_reads_every_frame_of_20_seconds_at_the_rates_asked_for() -> None:
    messages = decoded(sent(SimStream(), 20.0))
    counts = Counter(m.get_type() for m in messages)
    wanted = {"HIGHRES_IMU": 6666, "ATTITUDE_QUATERNION": 2000, "SIM_STATE": 2000, "GLOBAL_POSITION_INT": 1000}
    wanted |= {"GPS_RAW_INT": 200, "SCALED_PRESSURE": 200, "SYSTEM_TIME": 20, "SYS_STATUS": 40, "HEARTBEAT": 20}
    assert {name: counts[name] for name in wanted} == wanted
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(1, 1)}
    assert [m.get_seq() for m in messages] == [i % 256 for i in range(len(messages))]


def test_until_asked_there_are_only_heartbeats_of_an_ardupilot_quadrotor() -> None:
    found = by_type(sent(SimStream(rates_hz=ONLY_HEARTBEAT), 20.0))
    assert set(found) == {"HEARTBEAT"}
    assert len(found["HEARTBEAT"]) == 20
    first, last = found["HEARTBEAT"][0], found["HEARTBEAT"][-1]
    assert (first.type, first.autopilot, first.mavlink_version) == (2, 3, 3)
    assert not first.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert last.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED


def test_equal_settings_give_equal_bytes_however_the_time_is_cut() -> None:
    whole = sent(SimStream(SimSettings(seed=5)), 3.0)
    for step_ms in (1, 4, 17, 900):
        stream = SimStream(SimSettings(seed=5))
        parts = [frame for t in range(0, 3000 + step_ms, step_ms) for frame in stream.advance(min(t, 3000) * MS)]
        assert b"".join(parts) == whole
    assert sent(SimStream(SimSettings(seed=6)), 3.0) != whole


def test_an_interval_request_is_acknowledged_and_the_rate_really_changes_at_once() -> None:
    stream = SimStream(rates_hz=ONLY_HEARTBEAT)
    stream.advance(530 * MS)
    stream.receive(ask_interval(HIGHRES_IMU, 5000.0), 530 * MS)
    found = by_type(b"".join(stream.advance(1530 * MS)))
    ack = found["COMMAND_ACK"][0]
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (511, 0, 255, 190)
    assert len(found["HIGHRES_IMU"]) == 200
    assert found["HIGHRES_IMU"][0].time_usec == 535_000
    stream.receive(ask_interval(HIGHRES_IMU, -1.0), 1530 * MS)
    assert "HIGHRES_IMU" not in by_type(b"".join(stream.advance(2530 * MS)))


@pytest.mark.parametrize(
    ("rate_hz", "interval_us", "result"), [(333, 2900, 2), (333, 3003, 0), (100, 9000, 2), (1000, 1000, 0)]
)
def test_faster_than_the_board_grants_is_refused_and_leaves_the_rate(
    rate_hz: float, interval_us: float, result: int
) -> None:
    stream = SimStream(SimSettings(rate_hz=rate_hz), {0: 1.0, HIGHRES_IMU: 20.0})
    stream.receive(ask_interval(HIGHRES_IMU, interval_us), 0)
    found = by_type(b"".join(stream.advance(1000 * MS)))
    assert found["COMMAND_ACK"][0].result == result
    assert len(found["HIGHRES_IMU"]) == (20 if result else 1000 // int(interval_us // 1000))


def test_unknown_messages_are_denied_unknown_commands_unsupported_and_others_boards_left_alone() -> None:
    stream = SimStream(rates_hz=ONLY_HEARTBEAT)
    stream.receive(ask_interval(26, 1e5) + ask("command_long", 1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0), 0)
    stream.receive(ask_interval(HIGHRES_IMU, 1e4, target=2) + ask("heartbeat", 6, 8, 0, 0, 0) + b"noise\xfd\x01", 0)
    found = by_type(b"".join(stream.advance(500 * MS)))
    assert [(m.command, m.result) for m in found["COMMAND_ACK"]] == [(511, 2), (400, 3)]
    assert "HIGHRES_IMU" not in found
    assert "26" in found["STATUSTEXT"][0].text


def test_time_sync_is_answered_with_the_boards_time() -> None:
    stream = SimStream(rates_hz=ONLY_HEARTBEAT)
    stream.receive(ask("timesync", 0, 987654321) + ask("timesync", 5, 6), 123_456_789)
    (answer,) = by_type(b"".join(stream.advance(123_456_789)))["TIMESYNC"]
    assert (answer.tc1, answer.ts1) == (123_456_789, 987654321)
