"""The field model against NOAA's published test values, to their last digit."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from server.magnetic import WMM_EPOCH_YEAR, WMM_LAST_YEAR, wmm_field

HALF_DIGIT_NT = 0.05 + 1e-6


def _rows_2015(folder: Path) -> list[list[float]]:
    lines = (folder / "WMM2015_test_values.csv").read_text().splitlines()[1:]
    return [[float(cell) for cell in line.split(";")[:7]] for line in lines]


def _rows_2020(folder: Path) -> list[list[float]]:
    lines = (folder / "WMM2020_TEST_VALUES.txt").read_text().splitlines()
    cells = [[float(cell) for cell in line.split()] for line in lines if line.strip() and not line.startswith("#")]
    return [row[:4] + row[7:10] for row in cells]


def _rows_2025(folder: Path) -> list[list[float]]:
    lines = (folder / "WMM2025_TEST_VALUES.txt").read_text().splitlines()
    cells = [[float(cell) for cell in line.split()] for line in lines if line.strip() and not line.startswith("#")]
    return [row[:7] for row in cells]


@pytest.mark.parametrize(("reader", "count"), [(_rows_2015, 12), (_rows_2020, 100), (_rows_2025, 12)])
def test_every_published_test_value_is_met_to_its_last_digit(
    shared_data: Path, reader: Callable[[Path], list[list[float]]], count: int
) -> None:
    rows = reader(shared_data / "wmm_test_values")
    assert len(rows) == count
    for year, height_km, lat_deg, lon_deg, *field_nt in rows:
        field_gauss, used = wmm_field(lat_deg, lon_deg, height_km * 1e3, year)
        assert used == year
        assert np.max(np.abs(field_gauss * 1e5 - field_nt)) <= HALF_DIGIT_NT, (year, height_km, lat_deg, lon_deg)


def test_no_date_is_the_newest_models_own_epoch() -> None:
    unknown, used = wmm_field(47.4, 8.5, 500.0, math.nan)
    epoch, _ = wmm_field(47.4, 8.5, 500.0, WMM_EPOCH_YEAR)
    assert used == WMM_EPOCH_YEAR
    np.testing.assert_array_equal(unknown, epoch)


def test_a_date_outside_every_edition_is_held_at_the_end_and_reported() -> None:
    assert wmm_field(47.4, 8.5, 0.0, 1970.0)[1] == 2010.0
    late, used = wmm_field(47.4, 8.5, 0.0, 2055.0)
    assert used == WMM_LAST_YEAR
    np.testing.assert_array_equal(late, wmm_field(47.4, 8.5, 0.0, WMM_LAST_YEAR)[0])


def test_editions_meet_without_a_jump_a_compass_would_notice() -> None:
    for year in (2015.0, 2020.0, 2025.0):
        before, after = wmm_field(47.4, 8.5, 0.0, year - 1e-6)[0], wmm_field(47.4, 8.5, 0.0, year)[0]
        assert np.linalg.norm(after - before) < 2.5e-3  # the model's own error is 1.5 milligauss


def test_longitude_turns_and_unknown_height_do_not_matter_and_the_poles_are_finite() -> None:
    np.testing.assert_allclose(wmm_field(10.0, 190.0, 0.0, 2026.0)[0], wmm_field(10.0, -170.0, math.nan, 2026.0)[0])
    assert np.isfinite(wmm_field(90.0, 0.0, 0.0, 2026.0)[0]).all()
    assert np.isfinite(wmm_field(-90.0, 33.0, 0.0, 2026.0)[0]).all()


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(91.0, 0.0), (math.nan, 0.0), (0.0, math.inf)])
def test_a_place_that_is_not_on_earth_is_refused(lat_deg: float, lon_deg: float) -> None:
    with pytest.raises(ValueError, match="no magnetic field at"):
        wmm_field(lat_deg, lon_deg, 0.0, 2026.0)


def test_importing_the_module_does_not_load_the_library() -> None:
    code = "import sys, server.magnetic; sys.exit('pygeomag' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
