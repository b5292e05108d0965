"""BROAD as sensor folders: frames, signs, units and clock, proven against the optical reference and against nature."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.sets import broad, laws

UNDISTURBED = (1, 6, 10, 15, 21)
MAGNET_FRD_GAUSS = {33: (-0.03, 0.0, -0.26), 36: (0.019, 0.002, 0.058)}
Written = Callable[[int], Path]


@pytest.fixture(scope="module")
def written(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Written:
    folders: dict[int, Path] = {}

    def once(trial: int) -> Path:
        if trial not in folders:
            folders[trial] = broad.write(shared_data, tmp_path_factory.mktemp("broad"), trial)
        return folders[trial]

    return once


@pytest.mark.parametrize("trial", broad.TRIALS)
def test_the_gyro_turns_as_the_cameras_saw(written: Written, trial: int) -> None:
    angles = laws.gyro_against_reference_deg(written(trial))
    assert np.median(angles) < 1.5  # 1 % of what the fast trials turn; a wrong axis costs tens of degrees


@pytest.mark.parametrize("trial", broad.TRIALS)
def test_at_rest_the_specific_force_points_up(written: Written, trial: int) -> None:
    assert laws.rest_accel_n_m_s2(written(trial)).mean(axis=0) == pytest.approx([0.0, 0.0, -9.81], abs=0.12)


@pytest.mark.parametrize("trial", UNDISTURBED)
def test_the_field_is_the_same_in_every_attitude_and_points_north_and_down(written: Written, trial: int) -> None:
    field = laws.field_n_gauss(written(trial))
    assert field.mean(axis=0) == pytest.approx([0.15, 0.0, 0.41], abs=0.015)
    assert field.std(axis=0).max() < 0.03


@pytest.mark.parametrize("trial", sorted(MAGNET_FRD_GAUSS))
def test_the_attached_magnet_is_a_constant_vector_of_the_body(written: Written, trial: int) -> None:
    mag, R_nb = laws.Table(written(trial), "mag"), laws.attitude(written(trial))
    undisturbed_n = laws.field_n_gauss(written(trial), end_s=30.0).mean(axis=0)
    chosen = (mag.t_s > 60.0) & (mag.t_s < 90.0)
    offset = mag.vectors("mag", "gauss")[chosen] - R_nb(mag.t_s[chosen]).inv().apply(undisturbed_n)
    assert offset.mean(axis=0) == pytest.approx(MAGNET_FRD_GAUSS[trial], abs=0.02)


@pytest.mark.parametrize("trial", broad.TRIALS)
def test_rows_that_the_cameras_lost_are_left_out(shared_data: Path, written: Written, trial: int) -> None:
    reference, imu = laws.Table(written(trial), "reference"), laws.Table(written(trial), "imu")
    lost = np.isnan(broad.load(shared_data, trial)["opt_quat"]).any(axis=1)
    assert lost.any()
    assert np.array_equal(reference.t_ns, imu.t_ns[~lost])


@pytest.mark.parametrize("trial", broad.TRIALS)
def test_the_movement_mask_marks_the_motion(shared_data: Path, written: Written, trial: int) -> None:
    imu = laws.Table(written(trial), "imu")
    t_ns, moving = broad.movement(shared_data, trial)
    turning = np.linalg.norm(imu.vectors("gyro", "rad_s"), axis=1)
    assert np.array_equal(t_ns, imu.t_ns)
    assert imu.t_s[moving].min() > 25.0  # rest first: the gyro's bias can be learned
    assert turning[imu.t_s < 25.0].max() < 0.1 < np.median(turning[moving])
