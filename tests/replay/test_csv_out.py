"""Lane rows as text: exact, complete, empty where unknown."""

from __future__ import annotations

import math

import numpy as np

from server.nav.types import LANE_COLUMNS, LaneStatus
from server.replay.csv_out import csv_lines, header_line
from tests.replay.sensor_folders import OUTPUT_HEADER

STATUS = LANE_COLUMNS.index("status")


def test_the_header_is_the_contract_s() -> None:
    assert header_line().decode() == OUTPUT_HEADER + "\n"


def test_every_number_reads_back_to_itself_and_stamps_stay_integers() -> None:
    rng = np.random.default_rng(5)
    data = rng.normal(size=(40_000, len(LANE_COLUMNS))) * 10.0 ** rng.integers(-12, 9, (40_000, len(LANE_COLUMNS)))
    data[:, STATUS] = rng.integers(0, len(LaneStatus), 40_000)
    t_ns = 2**60 + 1 + np.arange(40_000, dtype=np.int64) * 20_000_001
    lines = [line.split(",") for line in csv_lines(t_ns, data).decode().splitlines()]
    assert [int(cells[0]) for cells in lines] == t_ns.tolist()
    assert [[float(cell) for cell in cells[1:-1]] for cells in lines] == data[:, :STATUS].tolist()
    assert {cells[-1] for cells in lines} == {"aligning", "attitude", "navigating", "dead_reckoning", "failed"}
    assert all(cells[-1] == LaneStatus(int(k)).name.lower() for cells, k in zip(lines, data[:, STATUS], strict=True))


def test_what_is_unknown_or_not_finite_is_an_empty_cell() -> None:
    data = np.full((3, len(LANE_COLUMNS)), math.nan)
    data[0, 7], data[1, 0], data[2, 24] = 47.123456789, math.inf, -0.5
    data[:, STATUS] = LaneStatus.ALIGNING
    first, second, third = (line.split(",") for line in csv_lines(np.array([1, 2, 3]), data).decode().splitlines())
    assert first == ["1", *[""] * 7, "47.123456789", *[""] * 17, "aligning"]
    assert second == ["2", *[""] * 25, "aligning"]
    assert third == ["3", *[""] * 24, "-0.5", "aligning"]


def test_no_rows_are_no_lines() -> None:
    assert csv_lines(np.empty(0, dtype=np.int64), np.empty((0, len(LANE_COLUMNS)))) == b""
