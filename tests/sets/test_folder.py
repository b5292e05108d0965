"""The shared writer says exactly what it was given, in the form the contract asks for."""

from pathlib import Path

import numpy as np
import pytest

from tests.sets import folder


def test_rows_are_written_in_the_order_of_their_stamps_and_nan_is_an_empty_cell(tmp_path: Path) -> None:
    folder.write_csv(tmp_path, "gnss", np.array([2**60 + 1, 7]), {"lat_deg": np.array([0.1, np.nan])})
    assert (tmp_path / "gnss.csv").read_text() == f"t_ns,lat_deg\n7,\n{2**60 + 1},0.1\n"


def test_numbers_read_back_to_the_same_float64(tmp_path: Path) -> None:
    values = np.random.default_rng(3).normal(size=(50, 3)) * 1e-7
    folder.write_mag(tmp_path, np.arange(50), values)
    back = np.loadtxt(tmp_path / "mag.csv", delimiter=",", skiprows=1)[:, 1:]
    assert np.array_equal(back, values)


def test_yaw_turns_clockwise_then_pitch_up_then_roll_right(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    q_nb = folder.quat_from_euler_deg(np.array([[0.0, 0.0, 90.0], [0.0, 90.0, 0.0], [90.0, 0.0, 0.0]]))
    assert q_nb == pytest.approx(np.array([[half, 0, 0, half], [half, 0, half, 0], [half, half, 0, 0]]))


def test_course_is_counted_from_north_over_east() -> None:
    velocity = folder.velocity_from_course(np.array([2.0, 3.0]), np.array([0.0, 90.0]), np.array([-1.0, 1.0]))
    assert velocity == pytest.approx(np.array([[2.0, 0.0, -1.0], [0.0, 3.0, 1.0]]))


def test_meta_is_toml_that_the_contract_knows(tmp_path: Path) -> None:
    folder.write_meta(tmp_path, "car", site={"date": "2025-07-08"}, gnss={"lever_arm_b_m": [0.0, -0.05, 0.0]})
    text = (tmp_path / "meta.toml").read_text()
    assert text == '[vehicle]\nclass = "car"\n[site]\ndate = 2025-07-08\n[gnss]\nlever_arm_b_m = [0.0, -0.05, 0.0]\n'
