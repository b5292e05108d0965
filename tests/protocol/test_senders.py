"""Whom the protocol listens to, and what each sender lost by its own sequence numbers."""

import math
from pathlib import Path

import pytest

from server.nav.types import Kind, VehicleClass
from server.protocol.mavlink import MavlinkProtocol
from tests.protocol.peer import Writer, decoded, feed_all, frame_list, random_cuts, rows_of

GCS = {"type": 6, "autopilot": 8}
COPTER = {"type": 2, "autopilot": 3}


def imu(writer: Writer, start_ms: int, count: int) -> bytes:
    return b"".join(writer("HIGHRES_IMU", time_usec=(start_ms + 10 * k) * 1000, zacc=-9.8) for k in range(count))


def stats_of(stream: bytes, **options: int) -> MavlinkProtocol:
    protocol = MavlinkProtocol(talk=False, **options)  # type: ignore[arg-type]
    protocol.feed(stream, 0)
    return protocol


def test_the_first_autopilot_that_sends_a_heartbeat_is_the_board() -> None:
    station, gimbal, copter = Writer(255, 190), Writer(7, 154), Writer(7, 1)
    stream = station("HEARTBEAT", **GCS) + gimbal("HEARTBEAT", type=26, autopilot=8) + imu(gimbal, 0, 5)
    stream += copter("HEARTBEAT", **COPTER) + imu(copter, 1000, 5) + imu(gimbal, 100, 5) + station("HEARTBEAT", **GCS)
    protocol = MavlinkProtocol(talk=False)
    (block,) = protocol.feed(stream, 0).blocks
    assert [row["t_ns"] for row in rows_of([block], Kind.IMU)] == [1_000_000_000 + 10_000_000 * k for k in range(5)]
    stats = protocol.stats
    assert stats.board == "ArduPilot quadrotor, system 7"
    assert stats.filtered_frames == 6
    assert [(s.system, s.component, s.frames) for s in stats.senders] == [(7, 1, 6), (7, 154, 11), (255, 190, 2)]


@pytest.mark.parametrize("options", [{"system": 9}, {"component": 5}, {"system": 9, "component": 5}])
def test_a_filter_chooses_another_board_on_the_same_link(options: dict[str, int]) -> None:
    one, other = Writer(1, 1), Writer(9, 5)
    stream = one("HEARTBEAT", **COPTER) + other("HEARTBEAT", type=1, autopilot=3)
    stream += imu(one, 1000, 4) + imu(other, 5000, 4)
    blocks = decoded(stream, **options)
    assert {row["t_ns"] // 1_000_000_000 for row in rows_of(blocks, Kind.IMU)} == {5}
    assert rows_of(blocks, Kind.PROFILE)[0]["vehicle_class"] == VehicleClass.FIXED_WING


def test_with_both_ids_given_no_heartbeat_is_needed() -> None:
    writer = Writer(3, 1)
    assert len(rows_of(decoded(imu(writer, 1000, 3), system=3, component=1), Kind.IMU)) == 3


def test_without_any_heartbeat_the_first_sender_of_imu_data_is_taken_after_one_and_a_half_seconds() -> None:
    writer = Writer(4, 1)
    stream = writer("ATTITUDE", time_boot_ms=900) + imu(writer, 1000, 200)
    rows = rows_of(decoded(stream), Kind.IMU)
    assert rows[0]["t_ns"] == 2_510_000_000
    assert rows_of(decoded(stream), Kind.PROFILE) == []


def test_a_heartbeat_that_comes_late_still_gives_the_profile_once() -> None:
    writer = Writer(4, 1)
    stream = imu(writer, 1000, 200) + writer("HEARTBEAT", type=10, autopilot=12) + imu(writer, 3000, 10)
    stream += writer("HEARTBEAT", type=10, autopilot=12) + imu(writer, 3100, 10)
    (profile,) = rows_of(decoded(stream), Kind.PROFILE)
    assert profile["t_ns"] == 3_000_000_000
    assert profile["vehicle_class"] == VehicleClass.CAR
    assert math.isnan(profile["gnss_delay_s"])  # only ArduPilot's delays are known


@pytest.mark.parametrize(
    ("mav_type", "expected"),
    [
        (0, VehicleClass.UNKNOWN),
        (1, VehicleClass.FIXED_WING),
        (2, VehicleClass.MULTIROTOR),
        (4, VehicleClass.MULTIROTOR),
        (10, VehicleClass.CAR),
        (13, VehicleClass.MULTIROTOR),
        (20, VehicleClass.UNKNOWN),
        (35, VehicleClass.MULTIROTOR),
        (200, VehicleClass.UNKNOWN),
    ],
)
def test_the_vehicle_class_follows_mav_type(mav_type: int, expected: VehicleClass) -> None:
    writer = Writer()
    stream = writer("HEARTBEAT", type=mav_type, autopilot=3) + imu(writer, 1000, 1)
    assert rows_of(decoded(stream), Kind.PROFILE)[0]["vehicle_class"] == expected


def test_another_board_on_the_same_port_is_a_new_boot() -> None:
    old, new = Writer(1, 1), Writer(2, 1)
    stream = old("HEARTBEAT", **COPTER) + imu(old, 5000, 10)
    for k in range(5):
        stream += new("HEARTBEAT", type=10, autopilot=3) + imu(new, 90_000 + 100 * k, 10)
    first, second = decoded(stream)
    assert (first.boot_id, second.boot_id) == (0, 1)
    assert second.t_ns[0] == 90_200_000_000  # behind its third heartbeat
    assert rows_of([second], Kind.PROFILE)[0]["vehicle_class"] == VehicleClass.CAR


def test_a_second_autopilot_does_not_take_over_while_the_first_one_talks() -> None:
    one, other = Writer(1, 1), Writer(2, 1)
    stream = one("HEARTBEAT", **COPTER)
    for k in range(20):
        stream += other("HEARTBEAT", **COPTER) + imu(one, 1000 + 10 * k, 1)
    assert [block.boot_id for block in decoded(stream)] == [0]
    assert len(rows_of(decoded(stream), Kind.IMU)) == 20


def test_losses_are_counted_over_the_wrap_of_the_sequence() -> None:
    writer = Writer(seq=250)
    stream = writer("HEARTBEAT", **COPTER)
    for gap in (0, 3, 0, 0, 200, 1, 254):
        writer.seq = (writer.seq + gap) & 255
        stream += writer("ATTITUDE")
    (sender,) = stats_of(stream).stats.senders
    assert (sender.frames, sender.lost) == (8, 458)


def test_removing_frames_of_the_mission_counts_exactly_those(shared_data: Path) -> None:
    frames = frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")[:20_000]
    from_board = [k for k, frame in enumerate(frames) if frame[5] == 1]
    removed = {from_board[k] for k in range(500, len(from_board) - 500, 17)}
    removed |= set(from_board[7_000:7_200])
    protocol = MavlinkProtocol(talk=False)
    feed_all(protocol, random_cuts(b"".join(f for k, f in enumerate(frames) if k not in removed), 1, 900))
    board = protocol.stats.senders[0]
    assert (board.system, board.lost) == (1, len(removed))


def test_a_duplicate_is_no_loss() -> None:
    writer = Writer()
    frame = writer("HEARTBEAT", **COPTER)
    stream = frame + frame + writer("ATTITUDE")
    assert stats_of(stream).stats.senders[0].lost == 0


def test_a_reconnect_is_no_loss_and_half_a_frame_becomes_junk() -> None:
    writer = Writer()
    protocol = MavlinkProtocol(talk=False)
    protocol.feed(writer("HEARTBEAT", **COPTER) + writer("ATTITUDE")[:9], 0)
    writer.seq = 77
    protocol.connected(1)
    protocol.feed(writer("ATTITUDE", roll=1.0), 2)
    stats = protocol.stats
    assert stats.senders[0].lost == 0
    assert (stats.frames, stats.bytes_junk, stats.bytes_pending) == (2, 9, 0)
    assert stats.bytes_in == stats.bytes_frames + stats.bytes_junk + stats.bytes_pending


def test_an_unknown_message_of_the_board_is_not_a_gap() -> None:
    writer = Writer()
    stream = writer("HEARTBEAT", **COPTER)
    unknown = writer("ATTITUDE", roll=1.0)
    stream += unknown[:7] + (60_999).to_bytes(3, "little") + unknown[10:] + writer("ATTITUDE")
    stats = stats_of(stream).stats
    assert (stats.unknown_messages, stats.senders[0].lost, stats.senders[0].frames) == (1, 0, 3)


def test_an_unchecked_frame_alone_makes_no_sender() -> None:
    frame = Writer(system=66)("ATTITUDE", roll=1.0)
    frame = frame[:7] + (60_999).to_bytes(3, "little") + frame[10:]
    assert stats_of(frame).stats.senders == ()
