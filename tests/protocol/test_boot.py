"""A power-up of the board is a step back of its clock that stays; nothing else is."""

import numpy as np
import pytest

from server.nav.types import Kind
from server.protocol.mavlink import MavlinkProtocol
from tests.protocol.peer import decoded, feed_all, random_cuts, rows_of
from tests.protocol.test_sources import Board


def run(board: Board, start_ms: int, stop_ms: int) -> None:
    for t_ms in range(start_ms, stop_ms, 10):
        board.highres(t_ms, xmag=0.2 + 1e-6 * t_ms)


def test_a_reboot_splits_the_blocks_and_forgets_the_old_power_up() -> None:
    board = Board()
    run(board, 60_000, 61_000)
    board.say("GPS_RAW_INT", time_usec=60_900_000, fix_type=3, lat=1, lon=1)
    board.seq = 0
    for t_ms in range(500, 1500, 100):
        board.raw(t_ms)
    run(board, 1500, 2000)
    first, second = decoded(board.stream)
    assert (first.boot_id, second.boot_id) == (0, 1)
    assert first.t_ns.min() == 60_000_000_000
    assert second.t_ns.max() < 2_000_000_000
    assert second.kind[0] == Kind.PROFILE  # once per power-up
    assert len(rows_of([first, second], Kind.PROFILE)) == 2
    # the hold for HIGHRES_IMU began again at the third, confirming stamp, 0.7 s
    assert rows_of([second], Kind.IMU)[0]["t_ns"] == 1_200_000_000


def test_a_reboot_is_not_a_loss_although_the_sequence_starts_again() -> None:
    board = Board()
    run(board, 60_000, 61_000)
    board.seq = 0
    run(board, 500, 1500)
    protocol = MavlinkProtocol(talk=False)
    feed_all(protocol, [board.stream])
    assert protocol.stats.boot_id == 1
    assert protocol.stats.senders[0].lost == 0


def test_real_losses_before_and_after_a_reboot_are_kept() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    board.seq += 5
    run(board, 60_500, 61_000)
    board.seq = 0
    run(board, 500, 1500)
    board.seq += 7
    run(board, 1500, 2500)
    protocol = MavlinkProtocol(talk=False)
    feed_all(protocol, [board.stream])
    assert protocol.stats.senders[0].lost == 12


@pytest.mark.parametrize("wrong_ms", [100, 30_000, 90_000, 4_000_000_000])
def test_one_or_two_wrong_stamps_are_dropped_and_change_nothing(wrong_ms: int) -> None:
    clean, damaged = Board(), Board()
    for board in (clean, damaged):
        run(board, 60_000, 60_500)
        if board is damaged:
            board.highres(wrong_ms)
            board.highres(wrong_ms + 3)
        run(board, 60_500, 61_000)
    (expected,), (found,) = decoded(clean.stream), decoded(damaged.stream)
    np.testing.assert_array_equal(found.t_ns, expected.t_ns)
    np.testing.assert_array_equal(found.data, expected.data)


def test_dropped_stamps_are_counted() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    board.highres(100)
    run(board, 60_500, 60_600)
    protocol = MavlinkProtocol(talk=False)
    feed_all(protocol, [board.stream])
    assert protocol.stats.disbelieved_stamps == 1


def test_scattered_wrong_stamps_never_make_a_reboot() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    for k in range(10):
        board.highres(1000 * (k * 37 % 50))
        board.highres(60_500 + k)
    assert {block.boot_id for block in decoded(board.stream)} == {0}


def test_a_board_that_restarts_seconds_after_its_power_up_is_noticed() -> None:
    board = Board()
    run(board, 2_000, 4_500)
    run(board, 300, 1000)
    assert [block.boot_id for block in decoded(board.stream)] == [0, 1]


def test_messages_a_little_out_of_order_are_no_reboot() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    board.say("ATTITUDE_QUATERNION", time_boot_ms=59_600, q1=1.0)
    board.say("ATTITUDE_QUATERNION", time_boot_ms=59_610, q1=1.0)
    board.say("ATTITUDE_QUATERNION", time_boot_ms=59_620, q1=1.0)
    run(board, 60_500, 60_600)
    (block,) = decoded(board.stream)
    assert len(rows_of([block], Kind.ONBOARD)) == 3


def test_a_frozen_gps_stamp_is_no_reboot() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    for k in range(10):
        board.say("GPS_RAW_INT", time_usec=1_000_000, fix_type=3, lat=1 + k, lon=1)
    run(board, 60_500, 61_000)
    assert len(decoded(board.stream)) == 1


def test_a_long_gap_of_the_link_is_the_same_power_up_and_costs_two_stamps() -> None:
    board = Board()
    run(board, 60_000, 60_500)
    run(board, 600_000, 600_500)
    (block,) = decoded(board.stream)
    stamps = [row["t_ns"] // 1_000_000 for row in rows_of([block], Kind.IMU)]
    assert stamps == [*range(60_000, 60_500, 10), *range(600_020, 600_500, 10)]


def test_the_split_does_not_depend_on_the_cuts() -> None:
    board = Board()
    for k in range(4):
        run(board, 60_000 - 10_000 * k, 60_400 - 10_000 * k)
    whole = decoded(board.stream)
    assert [block.boot_id for block in whole] == [0, 1, 2, 3]
    pieces = feed_all(MavlinkProtocol(talk=False), random_cuts(board.stream, 1, 50))
    np.testing.assert_array_equal(np.concatenate([b.t_ns for b in pieces]), np.concatenate([b.t_ns for b in whole]))
    boots = np.concatenate([np.full(len(b.t_ns), b.boot_id) for b in pieces])
    np.testing.assert_array_equal(boots, np.concatenate([np.full(len(b.t_ns), b.boot_id) for b in whole]))
