"""What is sent to a board, and how its answers and its silence steer it."""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from server.protocol.base import RequestStats
from server.protocol.mavlink import REQUESTS, MavlinkProtocol, requests_for
from server.protocol.mavlink.encode import OWN_COMPONENT, OWN_SYSTEM
from server.protocol.mavlink.requests import LINK_SHARE, MISSING_AFTER_NS, RETRY_AFTER_NS, needed_bytes_per_s
from tests.protocol.peer import Writer, frame_list, pymavlink_messages

STEP_NS = 20_000_000
ACCEPTED, REJECTED_NOW, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)


class Autopilot:
    """Answers SET_MESSAGE_INTERVAL by a rule, and nothing else."""

    def __init__(self, protocol: MavlinkProtocol, **options: Any) -> None:
        self.protocol = protocol
        self.writer = Writer()
        self.least_us = options.get("least_us", 3_000)
        self.unknown = options.get("unknown", ())
        self.result = options.get("result")
        self.silent = options.get("silent", False)
        self.target = options.get("target", (OWN_SYSTEM, OWN_COMPONENT))
        self.streaming = options.get("streaming", True)
        self.now_ns = 0
        self.heard: list[tuple[int, Any]] = []
        protocol.feed(self.writer("HEARTBEAT", type=2, autopilot=3), 0)

    def run(self, seconds: float) -> None:
        end_ns = self.now_ns + int(seconds * 1e9)
        while self.now_ns < end_ns:
            for message in pymavlink_messages(self.protocol.outgoing(self.now_ns))[0]:
                self.heard.append((self.now_ns, message))
                self.answer(message)
            if self.streaming:
                frame = self.writer("HIGHRES_IMU", time_usec=self.now_ns // 1000 + 1000, zacc=-9.8)
                self.protocol.feed(frame, self.now_ns)
            self.now_ns += STEP_NS

    def answer(self, message: Any) -> None:
        if message.get_type() != "COMMAND_LONG" or self.silent:
            return
        assert (message.target_system, message.target_component, message.command) == (1, 1, 511)
        result = self.result
        if result is None:
            refused = message.param2 < self.least_us or int(message.param1) in self.unknown
            result = DENIED if refused else ACCEPTED
        system, component = self.target
        ack = {"command": 511, "result": result, "target_system": system, "target_component": component}
        self.protocol.feed(self.writer("COMMAND_ACK", **ack), self.now_ns)

    def asked(self) -> list[tuple[int, int]]:
        return [(int(m.param1), int(m.param2)) for _, m in self.heard if m.get_type() == "COMMAND_LONG"]

    def of(self, name: str) -> Iterator[tuple[int, Any]]:
        return ((t, m) for t, m in self.heard if m.get_type() == name)


def states(protocol: MavlinkProtocol) -> dict[str, RequestStats]:
    return {item.message: item for item in protocol.stats.requests}


def test_everything_is_asked_for_once_when_the_board_agrees() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(3.0)
    assert board.asked() == [(item.message_id, item.intervals_us[0]) for item in REQUESTS]
    assert {item.state for item in board.protocol.stats.requests} == {"granted"}
    assert states(board.protocol)["HIGHRES_IMU"].granted_hz == pytest.approx(1000 / 3)
    assert board.protocol.stats.code == ""
    assert not list(board.of("REQUEST_DATA_STREAM"))


def test_a_refused_rate_leads_to_the_next_slower_one() -> None:
    board = Autopilot(MavlinkProtocol(), least_us=8_000)
    board.run(3.0)
    assert [us for message_id, us in board.asked() if message_id == 105] == [3_000, 5_000, 10_000]
    assert states(board.protocol)["HIGHRES_IMU"].granted_hz == pytest.approx(100.0)
    assert states(board.protocol)["HIGHRES_IMU"].wanted_hz == pytest.approx(1000 / 3)


def test_a_real_board_has_no_sim_state_and_that_is_no_trouble() -> None:
    board = Autopilot(MavlinkProtocol(), unknown=(108,))
    board.run(3.0)
    assert states(board.protocol)["SIM_STATE"].state == "refused"
    assert math.isnan(states(board.protocol)["SIM_STATE"].granted_hz)
    assert states(board.protocol)["SYS_STATUS"].state == "granted"
    assert board.protocol.stats.code == ""


def test_a_board_that_refuses_its_imu_is_asked_the_old_way_and_the_stats_say_so() -> None:
    board = Autopilot(MavlinkProtocol(), unknown=(105,))
    board.run(8.0)
    assert board.protocol.stats.code == "interval-refused"
    assert board.protocol.stats.cause
    assert board.protocol.stats.remedy
    streams = [m for _, m in board.of("REQUEST_DATA_STREAM")]
    assert {m.req_stream_id for m in streams} >= {1, 6, 10}
    assert all((m.target_system, m.target_component, m.start_stop) == (1, 1, 1) for m in streams)
    assert states(board.protocol)["GPS_RAW_INT"].state == "granted"


def test_a_board_that_does_not_know_the_command_is_asked_the_old_way_at_once() -> None:
    board = Autopilot(MavlinkProtocol(), result=UNSUPPORTED)
    board.run(2.0)
    assert len(board.asked()) == 1
    assert {item.state for item in board.protocol.stats.requests} == {"refused"}
    assert list(board.of("REQUEST_DATA_STREAM"))


def test_a_board_that_never_answers_is_asked_the_old_way_and_again_later() -> None:
    board = Autopilot(MavlinkProtocol(), silent=True)
    board.run(4.0)
    assert {item.state for item in board.protocol.stats.requests} == {"unanswered"}
    assert board.protocol.stats.code == "interval-unanswered"
    assert list(board.of("REQUEST_DATA_STREAM"))
    board.silent = False
    board.run(RETRY_AFTER_NS * 1e-9 + 3.0)
    assert {item.state for item in board.protocol.stats.requests} == {"granted"}
    assert board.protocol.stats.code == ""


def test_a_lost_answer_is_asked_for_again() -> None:
    board = Autopilot(MavlinkProtocol(), silent=True)
    board.run(1.0)
    board.silent = False
    board.run(4.0)
    assert {item.state for item in board.protocol.stats.requests} == {"granted"}
    assert [us for message_id, us in board.asked() if message_id == 105] == [3_000] * 3


def test_an_answer_to_another_ground_station_is_not_ours() -> None:
    board = Autopilot(MavlinkProtocol(), target=(255, 190))
    board.run(1.0)
    assert states(board.protocol)["HIGHRES_IMU"].state == "asked"


def test_an_answer_without_an_address_is_taken_for_ours() -> None:
    board = Autopilot(MavlinkProtocol(), target=(0, 0))
    board.run(2.0)
    assert states(board.protocol)["SYS_STATUS"].state == "granted"


@pytest.mark.parametrize("result", [IN_PROGRESS, REJECTED_NOW])
def test_not_yet_is_neither_yes_nor_no(result: int) -> None:
    board = Autopilot(MavlinkProtocol(), result=result)
    board.run(1.0)
    assert states(board.protocol)["HIGHRES_IMU"].state == "asked"
    board.result = None
    board.run(4.0)
    assert states(board.protocol)["SYS_STATUS"].state == "granted"


def test_after_a_reconnect_everything_is_asked_for_again_at_once() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(3.0)
    board.heard.clear()
    board.protocol.connected(board.now_ns)
    board.run(1.0)
    assert len(board.asked()) == len(REQUESTS)
    assert board.heard[0][1].get_type() == "HEARTBEAT"


def test_after_a_reboot_everything_is_asked_for_again() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(3.0)
    board.heard.clear()
    for k in range(4):
        board.protocol.feed(board.writer("ATTITUDE", time_boot_ms=500 + 10 * k), board.now_ns)
    assert board.protocol.stats.boot_id == 1
    board.streaming = False
    board.run(1.0)
    assert len(board.asked()) == len(REQUESTS)


def test_a_granted_imu_that_stays_away_is_asked_for_again() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(3.0)
    board.heard.clear()
    board.streaming = False
    board.run(MISSING_AFTER_NS * 1e-9 + 0.5)
    assert board.asked()[0] == (105, 3_000)


def test_a_heartbeat_goes_out_every_second_and_is_no_ground_stations() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(10.0)
    beats = list(board.of("HEARTBEAT"))
    assert [t for t, _ in beats] == [k * 1_000_000_000 for k in range(10)]
    message = beats[0][1]
    assert (message.get_srcSystem(), message.get_srcComponent()) == (254, 191)
    assert (message.type, message.autopilot) == (18, 8)


def test_our_frames_have_running_sequence_numbers() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(200.0)
    numbers = [m.get_seq() for _, m in board.heard]
    assert len(numbers) > 400
    assert all((b - a) & 255 == 1 for a, b in pairwise(numbers))


def test_nothing_but_a_heartbeat_is_sent_before_a_board_is_known() -> None:
    messages = pymavlink_messages(MavlinkProtocol().outgoing(5))[0]
    assert [m.get_type() for m in messages] == ["HEARTBEAT"]


def test_a_quiet_protocol_sends_nothing() -> None:
    board = Autopilot(MavlinkProtocol(talk=False))
    board.run(3.0)
    assert board.heard == []
    assert board.protocol.stats.requests == ()


def test_the_boards_time_question_is_answered_with_our_clock() -> None:
    board = Autopilot(MavlinkProtocol())
    board.run(0.5)
    board.protocol.feed(board.writer("TIMESYNC", tc1=0, ts1=40_009_823_001), 123_456_789)
    board.heard.clear()
    board.run(0.1)
    ((_, message),) = board.of("TIMESYNC")
    assert (message.tc1, message.ts1) == (123_456_789, 40_009_823_001)


@pytest.mark.parametrize("baud", [38_400, 57_600, 115_200, 230_400])
def test_a_slow_link_is_asked_for_no_more_than_it_carries(baud: int) -> None:
    slower = requests_for(baud / 10)
    assert 0.75 * LINK_SHARE * baud / 10 < needed_bytes_per_s(slower) <= LINK_SHARE * baud / 10
    assert all(list(item.intervals_us) == sorted(set(item.intervals_us)) for item in slower)
    by_name = {item.name: item.intervals_us[0] for item in slower}
    assert by_name["GPS_RAW_INT"] <= 200_000
    assert by_name["HIGHRES_IMU"] <= 50_000
    assert "SIM_STATE" not in by_name


def test_a_link_too_slow_for_anything_is_still_asked_for_the_least() -> None:
    assert {item.name: item.intervals_us[0] for item in requests_for(100.0)} == {
        item.name: item.slowest_us for item in REQUESTS if item.slowest_us
    }


def test_a_fast_link_is_asked_for_everything() -> None:
    assert requests_for(92_160) == REQUESTS


def test_the_sizes_in_the_table_are_those_of_the_recorded_frames(shared_data: Path) -> None:
    frames = frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")
    for item in REQUESTS:
        sizes = [len(frame) for frame in frames if int.from_bytes(frame[7:10], "little") == item.message_id]
        assert 0.85 * item.frame_bytes <= max(sizes) <= item.frame_bytes


def test_any_answer_at_any_time_is_harmless() -> None:
    board = Autopilot(MavlinkProtocol())
    for result in range(256):
        board.protocol.feed(board.writer("COMMAND_ACK", command=511, result=result), 0)
    board.run(3.0)
    assert states(board.protocol)["SYS_STATUS"].state == "granted"
    board.protocol.feed(board.writer("COMMAND_ACK", command=511, result=DENIED), 0)
    assert states(board.protocol)["SYS_STATUS"].state == "granted"
