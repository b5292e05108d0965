"""The turned demo board as others see it: its messages, through the decoder, through a real port, through the link."""

import asyncio
import itertools
import time
from typing import Any

import numpy as np
import pytest
import serial

from server.link import LinkState, open_link
from server.link.base import Turnable
from server.nav.calibration.types import FACES
from server.nav.types import Float, Kind
from server.protocol.mavlink import MavlinkProtocol
from server.sim import SimBoard, SimSettings, SimStream
from server.simulator import (
    DropLink,
    Fly,
    Magnet,
    SimulatorState,
    Spin,
    WindOnPitot,
    face_pose,
)
from tests.link.support import listening
from tests.sim.sim_frames import by_type, sent
from tests.sim.test_sim_board import Reader, named, request

MS = 1_000_000


def imu_after(stream: SimStream, seconds: float) -> Float:
    """The decoder's rows of the last second."""
    protocol = MavlinkProtocol(talk=False)
    parts = []
    for t_ns, data in stream.run(seconds):
        parts += [block.data[block.kind == Kind.IMU, :6] for block in protocol.feed(data, t_ns).blocks]
    return np.concatenate(parts)[-333:]


def test_the_decoder_sees_each_face_at_rest() -> None:
    stream = SimStream()
    for at, face in enumerate(FACES):
        stream.control(face_pose(face))
        imu = imu_after(stream, 7.0)
        demanded = np.zeros(3)
        demanded[at // 2] = 9.807 * (1.0, -1.0)[at % 2]
        if face in {"upside-down", "level"}:
            demanded = np.array([0.0, 0.0, 9.807 if face == "upside-down" else -9.807])
        np.testing.assert_allclose(imu[:, 3:].mean(axis=0), demanded, atol=0.07)
        assert imu[:, 3:].std(axis=0).max() < 0.03
        assert np.abs(imu[:, :3].mean(axis=0)).max() < np.radians(0.4)


def test_looking_changes_nothing_and_a_command_changes_nothing_before_it_is_given() -> None:
    watched, plain = SimStream(SimSettings(seed=8)), SimStream(SimSettings(seed=8))
    for t_ms in range(100, 5000, 100):
        watched.state(t_ms * MS)
        assert watched.advance(t_ms * MS) == plain.advance(t_ms * MS)
    watched.control(Spin())
    watched.control(Fly())
    assert watched.advance(5000 * MS) == plain.advance(5000 * MS), "the block that is under way"
    assert watched.advance(9000 * MS) != plain.advance(9000 * MS)


def test_equal_commands_at_equal_times_give_equal_bytes() -> None:
    streams = [SimStream(SimSettings(seed=2)) for _ in range(2)]
    for t_ms, command in ((1300, Spin(duration_s=6.0)), (4100, Magnet(is_on=True)), (6000, Fly()), (14000, None)):
        first, second = (b"".join(one.advance(t_ms * MS)) for one in streams)
        assert first == second
        for one in streams:
            if command is not None:
                one.control(command)


def test_in_the_hand_it_is_disarmed_says_nothing_of_flights_and_its_own_estimate_is_near_the_truth() -> None:
    stream = SimStream()
    sent(stream, 40.0)
    stream.control(Spin(duration_s=10.0))
    found = by_type(sent(stream, 160.0))
    assert not any(message.base_mode & 128 for message in found["HEARTBEAT"][1:])
    assert "STATUSTEXT" not in found
    at_s = np.array([m.time_boot_ms for m in found["ATTITUDE_QUATERNION"]]) * 1e-3
    q, truth = (
        np.array([[getattr(m, n) for n in ("q1", "q2", "q3", "q4")] for m in found[name]])
        for name in ("ATTITUDE_QUATERNION", "SIM_STATE")
    )
    apart = np.degrees(2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(q * truth, axis=1)))))
    assert apart.max() < 3.0
    home = [m for m in found["GLOBAL_POSITION_INT"] if m.time_boot_ms > (at_s[0] + 12.0) * 1e3]
    assert max(abs(m.relative_alt) for m in home) < 1500
    assert max(abs(m.lat - 473977000) for m in home) < 150
    stream.control(Fly())
    texts = [m.text for m in by_type(sent(stream, 20.0))["STATUSTEXT"]]
    assert texts == ["Arming motors", "Demo flight: take-off"]


@pytest.fixture
def board() -> Any:
    board = SimBoard(SimSettings(speed=4.0, noise=0.1))
    board.start()
    yield board
    board.stop()


def answered(board: SimBoard, command: Any = None) -> SimulatorState:
    return board.ask(command).result(5.0)


def test_a_board_behind_a_port_is_turned_from_outside_while_it_is_read(board: SimBoard) -> None:
    with serial.Serial(board.path, 921600, timeout=0.02, exclusive=True) as port:
        port.write(request(105, 10_000))
        state = answered(board, face_pose("nose-up"))
        assert (state.mode, state.action, state.name) == ("in-hand", "pose", "nose-up")
        assert state.is_moving
        assert 1.4 < state.remaining_s < 3.0
        messages = Reader(port).until(lambda m: any(one.xacc > 9.7 for one in named(m[-50:], "HIGHRES_IMU")))
    sequence = [m.get_seq() for m in messages]
    assert [(b - a) % 256 for a, b in itertools.pairwise(sequence)] == [1] * (len(sequence) - 1)
    deadline = time.monotonic() + 10.0
    while (state := answered(board)).is_moving:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert state.down_b == pytest.approx((-1.0, 0.0, 0.0), abs=1e-6)
    assert (state.mode, state.remaining_s) == ("in-hand", 0.0)


def test_what_a_board_cannot_do_comes_back_to_whoever_asked(board: SimBoard) -> None:
    with pytest.raises(ValueError, match="no pressure tube"):
        answered(board, WindOnPitot(is_on=True))
    assert answered(board).mode == "flying"


def test_a_board_that_does_not_run_says_so() -> None:
    board = SimBoard()
    with pytest.raises(ConnectionError):
        answered(board)
    board.start()
    assert answered(board).mode == "flying"
    board.stop()
    with pytest.raises(ConnectionError):
        answered(board, Spin())


def test_a_dropped_link_is_silent_for_its_time_deaf_too_and_then_goes_on_where_the_board_is(board: SimBoard) -> None:
    with serial.Serial(board.path, 921600, timeout=0.02, exclusive=True) as port:
        reader = Reader(port)
        port.write(request(105, 10_000))
        before = reader.until(lambda m: len(named(m, "HIGHRES_IMU")) > 20)
        assert 0.5 < answered(board, DropLink(duration_s=1.0)).link_back_s <= 1.0
        port.write(request(105, -1))
        before += reader.until(lambda _: not port.in_waiting)
        after = reader.until(lambda m: len(named(m, "HIGHRES_IMU")) > 20)
    assert answered(board).link_back_s == 0.0
    assert (after[0].get_seq() - before[-1].get_seq()) % 256 > 1, "it went on talking, unheard"
    gap_s = 1e-6 * (named(after, "HIGHRES_IMU")[0].time_usec - named(before, "HIGHRES_IMU")[-1].time_usec)
    assert gap_s > 3.5, "a second of the host's is four of the board's"


async def test_the_link_turns_its_board_and_says_when_there_is_none() -> None:
    link = open_link("sim:?errors=raw")
    assert isinstance(link, Turnable)
    with pytest.raises(ConnectionError):
        await link.control()
    async with listening(link) as heard:
        await heard.until(lambda: link.status.state is LinkState.OPEN)
        state = await link.control(face_pose("right-up"))
        assert (state.name, state.has_airspeed, state.is_uncalibrated) == ("right-up", True, True)
        assert (await link.control(WindOnPitot(is_on=True))).is_wind_on_pitot
        assert (await asyncio.gather(*(link.control() for _ in range(20))))[-1].mode == "in-hand"
    with pytest.raises(ConnectionError):
        await link.control()
