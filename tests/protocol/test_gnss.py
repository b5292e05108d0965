"""GPS_RAW_INT: fresh fixes once, an outage told once a second and never as a position."""

import math
from typing import Any

import pytest

from server.nav.types import Kind
from tests.protocol.peer import Row
from tests.protocol.test_sources import Board

FIX = {
    "fix_type": 3,
    "lat": 473977420,
    "lon": -85455940,
    "alt": 488370,
    "vel": 500,
    "cog": 9000,
    "satellites_visible": 10,
    "h_acc": 300,
    "v_acc": 450,
    "vel_acc": 14,
}


def row_of(**fields: Any) -> Row:
    board = Board()
    board.highres(1000)
    board.say("GPS_RAW_INT", **{"time_usec": 990_000, **FIX, **fields})
    (row,) = board.rows(Kind.GNSS)
    return row


def test_a_fix_in_si_units_with_no_downward_velocity() -> None:
    row = row_of()
    assert row["t_ns"] == 990_000_000
    assert (row["lat_deg"], row["lon_deg"], row["alt_m"]) == pytest.approx((47.397742, -8.545594, 488.37), abs=1e-12)
    assert (row["vel_n_m_s"], row["vel_e_m_s"]) == pytest.approx((0.0, 5.0), abs=1e-12)
    assert math.isnan(row["vel_d_m_s"])
    assert (row["h_acc_m"], row["v_acc_m"], row["s_acc_m_s"]) == pytest.approx((0.3, 0.45, 0.014))
    assert (row["fix_type"], row["satellites"]) == (3, 10)


def test_what_the_receiver_does_not_know_is_nan() -> None:
    row = row_of(h_acc=0, v_acc=0, vel_acc=0, satellites_visible=255)
    assert all(math.isnan(row[name]) for name in ("h_acc_m", "v_acc_m", "s_acc_m_s", "satellites"))
    for unknown in ({"vel": 65535}, {"cog": 65535}):
        row = row_of(**unknown)
        assert math.isnan(row["vel_n_m_s"])
        assert math.isnan(row["vel_e_m_s"])


def test_a_two_dimensional_fix_has_no_height() -> None:
    row = row_of(fix_type=2)
    assert math.isnan(row["alt_m"])
    assert row["lat_deg"] == pytest.approx(47.397742)


@pytest.mark.parametrize(("theirs", "ours"), [(4, 4), (5, 5), (6, 6), (7, 3), (8, 4), (9, 0), (255, 0), (1, 1), (0, 0)])
def test_fix_types_are_translated(theirs: int, ours: int) -> None:
    assert row_of(fix_type=theirs)["fix_type"] == ours


def test_an_accuracy_beyond_two_to_the_31_millimetres_is_not_negative() -> None:
    assert row_of(h_acc=4_294_967_295)["h_acc_m"] == pytest.approx(4_294_967.295)


def test_the_same_fix_sent_twice_is_one_row() -> None:
    board = Board()
    for k in range(20):
        board.highres(1000 + 100 * k)
        board.say("GPS_RAW_INT", time_usec=1_000_000 + 200_000 * (k // 2), **FIX)
    assert [row["t_ns"] for row in board.rows(Kind.GNSS)] == [1_000_000_000 + 200_000_000 * k for k in range(10)]


def test_a_better_fix_type_at_the_same_stamp_is_a_row() -> None:
    board = Board()
    board.highres(1000)
    board.say("GPS_RAW_INT", time_usec=1_000_000, **FIX)
    board.say("GPS_RAW_INT", time_usec=1_000_000, **{**FIX, "fix_type": 6})
    assert [row["fix_type"] for row in board.rows(Kind.GNSS)] == [3, 6]


def test_an_outage_is_told_at_once_then_once_a_second_of_board_time_without_its_stale_position() -> None:
    board = Board()
    for k in range(60):
        t_ms = 1000 + 100 * k
        board.highres(t_ms)
        outage = 10 <= k < 45
        usec = 1_900_000 if outage else t_ms * 1000
        board.say("GPS_RAW_INT", time_usec=usec, **{**FIX, "fix_type": 1 if outage else 3})
    rows = board.rows(Kind.GNSS)
    lost = [row for row in rows if row["fix_type"] == 1]
    assert [row["t_ns"] // 1_000_000 for row in lost] == [2000, 3000, 4000, 5000]
    assert all(math.isnan(row[name]) for row in lost for name in ("lat_deg", "alt_m", "vel_n_m_s", "h_acc_m"))
    assert [row["t_ns"] // 1_000_000 for row in rows if row["fix_type"] == 3] == [
        *range(1000, 2000, 100),
        *range(5500, 7000, 100),
    ]


@pytest.mark.parametrize("usec", [1_795_312_368_672_182, 0, 12_000_000, 2**63 + 5])
def test_a_stamp_that_is_not_since_power_up_becomes_the_boards_newest(usec: int) -> None:
    assert row_of(time_usec=usec)["t_ns"] == 1_000_000_000


def test_a_second_receiver_is_counted_and_not_mixed_in() -> None:
    board = Board()
    board.highres(1000)
    board.say("GPS2_RAW", time_usec=1_000_000, fix_type=3, lat=10, lon=10)
    assert board.rows(Kind.GNSS) == []
