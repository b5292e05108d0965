"""The board that nobody has calibrated: its errors are as large as data sheets say, known, and are what it reads."""

import math

import numpy as np
import pytest

from server.magnetic import wmm_field
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import FACES
from server.nav.types import SAMPLE_COLUMNS, Float, Kind
from server.protocol.mavlink import MavlinkProtocol
from server.sim import SimSettings, SimStream, sim_settings
from server.sim.errors import RawErrors
from server.sim.sensors import BLOCK, Sensors
from server.simulator import Magnet, Spin, WindOnPitot, face_pose

FIELD_N, _ = wmm_field(47.3977, 8.5456, 488.0, 2026.41)


def undone(errors: RawErrors) -> Calibration:
    """What a perfect calibration would apply."""
    return Calibration(
        gyro_matrix=np.linalg.inv(errors.gyro_matrix),
        gyro_offset=errors.gyro_offset,
        accel_matrix=np.linalg.inv(errors.accel_matrix),
        accel_offset=errors.accel_offset,
        mag_matrix=np.linalg.inv(errors.mag_matrix),
        mag_offset=errors.mag_offset,
        level=errors.R_bs,
        diff_pressure_bias_pa=errors.diff_pressure_pa,
    )


def samples(kind: Kind, columns: tuple[Float, ...]) -> Float:
    rows = np.full((len(columns[0]), 10), np.nan)
    table = np.concatenate(columns, axis=1)
    rows[:, : table.shape[1]] = table
    return rows[:, : max(len(SAMPLE_COLUMNS[kind]), table.shape[1])]


@pytest.mark.parametrize("seed", range(8))
def test_the_errors_are_worth_calibrating_and_no_larger_than_data_sheets_allow(seed: int) -> None:
    errors = SimStream(SimSettings(seed=seed, errors="raw")).truth_errors
    assert 0.15 < np.abs(errors.accel_offset).min() < np.abs(errors.accel_offset).max() < 0.4
    assert 0.8 < np.degrees(np.abs(errors.gyro_offset)).min() < np.degrees(np.abs(errors.gyro_offset)).max() < 2.4
    assert 0.09 < np.abs(errors.mag_offset).min() < np.abs(errors.mag_offset).max() < 0.21
    for matrix, least, most in ((errors.accel_matrix, 0.018, 0.032), (errors.gyro_matrix, 0.008, 0.032)):
        scale = np.abs(np.diag(matrix) - 1.0)
        assert least < scale.min() <= scale.max() < most
    np.testing.assert_array_equal(errors.mag_matrix, errors.mag_matrix.T)
    assert np.abs(np.diag(errors.mag_matrix) - 1.0).min() >= 0.05
    assert 2.0 <= math.degrees(math.acos(errors.R_bs[2, 2])) <= 3.0
    assert (errors.diff_pressure_pa, errors.baro_pa) == (35.0, 120.0)


def test_undoing_the_true_errors_gives_the_true_values_in_every_pose() -> None:
    sensors = Sensors(SimSettings(noise=0.0, errors="raw"))
    truth = undone(sensors.truth_errors)
    for face in FACES:
        sensors.stage.take(face_pose(face))
        block = [sensors.step() for _ in range(20)][-1]
        imu = truth.rows(Kind.IMU, samples(Kind.IMU, (block.imu, np.full((BLOCK, 1), 25.0))))
        np.testing.assert_allclose(imu[:, :6], block.imu_true, atol=1e-9)
        mag = truth.rows(Kind.MAG, samples(Kind.MAG, (block.mag_gauss,)))
        np.testing.assert_allclose(mag[:, :3], np.vecmat(FIELD_N, block.state.R_nb[[50, 150, 150]]), atol=1e-9)
        assert block.diff_pa is not None
        np.testing.assert_allclose(block.diff_pa, 35.0, atol=1e-9)


def test_while_it_turns_the_raw_rates_are_the_true_ones_through_matrix_and_offset() -> None:
    sensors, ideal = (Sensors(SimSettings(noise=0.0, errors=errors)) for errors in ("raw", "calibrated"))
    truth = undone(sensors.truth_errors)
    for one in (sensors, ideal):
        one.stage.take(Spin())
    for _ in range(60):
        raw, true = sensors.step(), ideal.step()
        imu = truth.rows(Kind.IMU, samples(Kind.IMU, (raw.imu, np.full((BLOCK, 1), 25.0))))
        np.testing.assert_allclose(imu[:, :6], true.imu, atol=1e-9)


def test_with_noise_and_warmth_the_errors_said_are_those_in_force() -> None:
    """The mean of 20 s at rest, after two minutes of warming up, undone by what the board says then."""
    sensors = Sensors(SimSettings(seed=3, errors="raw"))
    sensors.stage.take(face_pose("left-up"))
    blocks = [sensors.step() for _ in range(700)][-100:]
    truth = undone(sensors.truth_errors)
    mean = np.mean([np.append(block.imu.mean(axis=0), 25.0) for block in blocks], axis=0)[None]
    mag = np.mean([block.mag_gauss[1:].mean(axis=0) for block in blocks], axis=0)[None]
    imu = truth.rows(Kind.IMU, samples(Kind.IMU, (mean,)))[0]
    np.testing.assert_allclose(imu[:6], blocks[-1].imu_true[-1], atol=3e-3)
    field_b = truth.rows(Kind.MAG, samples(Kind.MAG, (mag,)))[0, :3]
    np.testing.assert_allclose(field_b, FIELD_N @ blocks[-1].state.R_nb[-1], atol=1e-3)


def test_a_magnet_is_seen_through_the_soft_iron_too() -> None:
    sensors, plain = (Sensors(SimSettings(errors="raw")) for _ in range(2))
    sensors.stage.take(Magnet(is_on=True, field_b_gauss=(0.1, 0.2, -0.1)))
    errors = plain.truth_errors
    seen = [sensors.step().mag_gauss - plain.step().mag_gauss for _ in range(5)][-1]
    np.testing.assert_allclose(seen, [errors.mag_matrix @ errors.R_bs.T @ [0.1, 0.2, -0.1]] * 3, atol=1e-12)


def decoded(stream: SimStream, kind: Kind, seconds: float, from_s: float = 0.0) -> Float:
    protocol = MavlinkProtocol(talk=False)
    blocks = (block for t_ns, data in stream.run(seconds) for block in protocol.feed(data, t_ns).blocks)
    rows = [block.data[(block.kind == kind) & (block.t_ns >= from_s * 1e9)] for block in blocks]
    return np.concatenate(rows)


def test_the_decoder_finds_the_pressure_tube_with_its_offset_and_the_wind_on_it() -> None:
    stream = SimStream(SimSettings(errors="raw"))
    stream.control(face_pose("level"))
    calm = decoded(stream, Kind.AIRSPEED, 20.0, from_s=3.0)
    assert len(calm) > 150
    assert calm[:, 0].mean() == pytest.approx(35.0, abs=1.0)
    assert calm[:, 0].std() < 1.5
    stream.control(WindOnPitot(is_on=True))
    windy = decoded(stream, Kind.AIRSPEED, 20.0)
    assert windy[:, 0].mean() > 40.0
    assert windy[:, 0].std() > 4.0


def test_a_board_without_a_tube_gives_no_airspeed() -> None:
    assert len(decoded(SimStream(), Kind.AIRSPEED, 5.0)) == 0


def test_the_barometer_reads_120_pascal_more() -> None:
    cared_for, raw = (SimStream(SimSettings(errors=errors)) for errors in ("calibrated", "raw"))
    pressure = [decoded(one, Kind.BARO, 8.0)[:, 0] for one in (cared_for, raw)]
    np.testing.assert_allclose(pressure[1] - pressure[0], 120.0, atol=0.02)


def test_the_link_asks_for_raw_errors_by_name_and_for_nothing_else() -> None:
    assert sim_settings("sim:?errors=raw") == SimSettings(errors="raw")
    assert sim_settings("sim:?errors=calibrated") == SimSettings()
    with pytest.raises(ValueError, match=r"errors='cooked' is neither calibrated nor raw; write errors=raw"):
        sim_settings("sim:?errors=cooked")
