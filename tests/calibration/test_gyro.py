"""Gyro bias at rest and scale from whole turns: recovery, the recorded turns, units, cuts, refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from server.nav.calibration.gyro_bias import GyroBias
from server.nav.calibration.gyro_scale import GyroScale
from server.nav.calibration.types import Fit, Options
from server.nav.types import Float, Int, Kind
from tests.calibration.imu_made import S0_BIAS, UP, Made, table


def bias_of(t_ns: Int, gyro: Float, **options: object) -> Fit:
    collector = GyroBias(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    collector.feed(Kind.IMU, t_ns, table(gyro, None, len(t_ns)))
    return collector.fit()


def rest(seconds: float, rate_hz: float, noise: float, seed: int) -> tuple[Int, Float]:
    n = round(seconds * rate_hz)
    gyro = S0_BIAS + np.random.default_rng(seed).normal(0.0, noise, (n, 3))
    return np.round(np.arange(n) / rate_hz * 1e9).astype(np.int64), gyro


def turn_stream(
    axis: int = 2, turns: float = 1.0, seconds: float = 6.0, rate_hz: float = 100.0, scale: float = 1.02, seed: int = 0
) -> tuple[Int, Float]:
    """Return stamps and raw rates of rest, turn, rest."""
    made = Made(rate_hz=rate_hz)
    made.hold(UP[5], 2.5)
    made.turn(axis, 2.0 * np.pi * turns, seconds, UP[5])
    made.hold(UP[5], 2.5)
    t_ns, _, rate = made.stream()
    return t_ns, rate / scale + S0_BIAS + np.random.default_rng(seed).normal(0.0, 0.004, rate.shape)


def scale_fit(t_ns: Int, gyro: Float, **options: object) -> Fit:
    collector = GyroScale(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    collector.feed(Kind.IMU, t_ns, table(gyro, None, len(t_ns)))
    return collector.fit()


def refusal(fit: Fit) -> str:
    assert fit.failure is not None
    return fit.failure.code


@pytest.mark.parametrize(("rate_hz", "correlation"), [(10.0, 0.0), (100.0, 0.0), (100.0, 0.8), (1000.0, 0.0)])
def test_the_theses_bias_comes_back_within_three_sigma_also_from_correlated_noise(
    rate_hz: float, correlation: float
) -> None:
    """60 boards, 180 numbers; the correlated noise is low-passed as boards do, which a white sigma misses by 3."""
    z = []
    for seed in range(60):
        t_ns, gyro = rest(6.0, rate_hz, 0.003, seed)
        noise = gyro - S0_BIAS
        for k in range(1, len(noise)):
            noise[k] += correlation * noise[k - 1]
        fit = bias_of(t_ns, S0_BIAS + noise)
        z.append((fit.parameters["bias"] - S0_BIAS) / fit.sigma["bias"])
    assert np.mean(np.abs(z) > 3.0) <= 0.025
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_fifty_samples_are_enough_and_forty_are_not() -> None:
    t_ns, gyro = rest(0.12, 500.0, 0.003, 1)
    assert bias_of(t_ns[:50], gyro[:50]).ok
    assert refusal(bias_of(t_ns[:40], gyro[:40])) == "too-few-samples"
    assert refusal(bias_of(t_ns[:0], gyro[:0])) == "no-data"


def test_a_move_restarts_and_the_longest_rest_counts() -> None:
    t_ns, gyro = rest(10.0, 100.0, 0.003, 2)
    gyro[200:260] += 0.5 * np.sin(np.arange(60)[:, None] * 0.3)
    fit = bias_of(t_ns, gyro)
    assert fit.details["restarts"] == 1.0
    assert fit.samples > 600
    np.testing.assert_allclose(fit.parameters["bias"], gyro[300:].mean(axis=0), atol=2e-4)


def test_motion_and_a_steady_turn_are_refused() -> None:
    t_ns, gyro = rest(10.0, 100.0, 0.003, 3)
    swing = 0.3 * np.sin(2.0 * np.pi * 0.7 * t_ns[:, None] * 1e-9)
    assert refusal(bias_of(t_ns, gyro + swing)) == "motion"
    assert refusal(bias_of(t_ns, gyro + np.array([0.0, 0.0, 0.3]))) == "out-of-range"
    gyro[::90] += 1.0
    assert refusal(bias_of(t_ns, gyro, duration_s=5.0)) == "motion"


def test_a_rest_is_taken_though_the_steady_turn_of_a_table_is_longer() -> None:
    t_ns, gyro = rest(10.0, 100.0, 0.003, 7)
    gyro[250:800, 2] += 1.2
    fit = bias_of(t_ns, gyro)
    np.testing.assert_allclose(fit.parameters["bias"], S0_BIAS, atol=1e-3)
    assert 200 <= fit.samples <= 250


def test_a_coarse_gyro_at_rest_has_its_step_in_the_sigma() -> None:
    """131 counts a degree per second and less noise than a step: the mean is wrong by up to half a step."""
    t_ns, gyro = rest(5.0, 100.0, 2e-5, 8)
    counts = np.round(gyro * 7506.0)
    for unit, factor in (("raw", 1.0), ("si", 1.0 / 7506.0)):
        values = counts.copy()
        values[::50, 0] += 1.0  # a step shows at all
        fit = bias_of(t_ns, values * factor, unit=unit)
        off = np.asarray(fit.parameters["bias"]) / factor - S0_BIAS * 7506.0
        assert np.max(np.abs(off / (np.asarray(fit.sigma["bias"]) / factor))) < 3.0


def test_bias_in_counts_is_the_bias_in_si_times_the_scale() -> None:
    t_ns, gyro = rest(8.0, 100.0, 0.003, 4)
    si, raw = bias_of(t_ns, gyro), bias_of(t_ns, gyro * 6258.0 + 32768.0, unit="raw")
    np.testing.assert_allclose((raw.parameters["bias"] - 32768.0) / 6258.0, si.parameters["bias"], atol=1e-5)
    np.testing.assert_allclose(raw.sigma["bias"] / 6258.0, si.sigma["bias"], rtol=0.05)


@pytest.mark.parametrize(("rate_hz", "seconds", "turns"), [(10.0, 20.0, 2), (100.0, 5.0, -1), (1000.0, 8.0, 3)])
@pytest.mark.parametrize("axis", [0, 2])
def test_whole_turns_in_either_sense_give_the_scale_and_leave_the_other_axes_alone(
    rate_hz: float, seconds: float, turns: int, axis: int
) -> None:
    t_ns, gyro = turn_stream(axis, turns, seconds, rate_hz)
    for factor, shift, options in ((1.0, 0.0, {}), (6258.0, 32768.0, {"unit": "raw", "turns": abs(turns)})):
        fit = scale_fit(t_ns, gyro * factor + shift, **options)
        scale, sigma = np.asarray(fit.parameters["scale"]) * factor, np.asarray(fit.sigma["scale"]) * factor
        assert abs(scale[axis] - 1.02) < 3.0 * sigma[axis]
        assert abs(scale[axis] - 1.02) < 0.004
        assert sigma[axis] < 0.01
        others = [i for i in range(3) if i != axis]
        assert np.all(np.asarray(fit.parameters["scale"])[others] == 1.0)
        assert np.all(np.isnan(sigma[others]))


def test_a_slow_turntable_loses_nothing_to_the_bias() -> None:
    """One turn a minute: leaving S0's bias in, as S1 (3.10) does, would cost 5 % here on z."""
    t_ns, gyro = turn_stream(2, 1.0, 60.0)
    fit = scale_fit(t_ns, gyro)
    error = abs(np.asarray(fit.parameters["scale"])[2] - 1.02)
    assert error < min(0.01, 3.0 * np.asarray(fit.sigma["scale"])[2])


def test_cutting_the_stream_changes_no_bit() -> None:
    t_ns, gyro = turn_stream()
    whole, cut = scale_fit(t_ns, gyro), GyroScale(Options())
    rows = table(gyro, None, len(t_ns))
    for at in range(0, len(t_ns), 13):
        cut.feed(Kind.IMU, t_ns[at : at + 13], rows[at : at + 13])
    assert np.asarray(cut.fit().parameters["scale"]).tobytes() == np.asarray(whole.parameters["scale"]).tobytes()


def test_recorded_turns_give_the_scale_that_their_sums_give(shared_data: Path) -> None:
    folder = shared_data / "imucal_ferraris"
    data = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    listed = json.loads((folder / "example_ferraris_session_list.json").read_text())
    t_ns, gyro = np.round(data[:, 0] / 102.4 * 1e9).astype(np.int64), data[:, 1:4]
    bias = gyro[listed["x_p"]["start"] : listed["x_p"]["end"]].mean(axis=0)
    sums = [
        abs(float(np.sum(gyro[listed[f"{axis}_rot"]["start"] : listed[f"{axis}_rot"]["end"], i] - bias[i])))
        for i, axis in enumerate("xyz")
    ]
    expected = 360.0 * 102.4 / np.array(sums)
    si = scale_fit(t_ns, np.radians(gyro))
    raw = scale_fit(t_ns, gyro, unit="raw", turns=1.0)
    np.testing.assert_allclose(si.parameters["scale"], expected, rtol=0.004)
    np.testing.assert_allclose(np.degrees(np.asarray(raw.parameters["scale"])), expected, rtol=0.004)
    ranges = [(listed[name]["start"], listed[name]["end"]) for name in ("x_p", "x_rot", "y_rot", "z_rot")]
    given = GyroScale(Options()).fit_ranges(t_ns, table(np.radians(gyro), None, len(gyro)), ranges)
    np.testing.assert_allclose(given.parameters["scale"], expected, rtol=0.001)


def test_what_is_no_whole_turn_is_refused_with_its_reason() -> None:
    assert refusal(scale_fit(*rest(8.0, 100.0, 0.003, 5))) == "not-turned"
    assert refusal(scale_fit(*turn_stream(2, 0.2))) == "not-turned"
    steady = np.array([0.0, 0.0, 1.5]) + np.random.default_rng(6).normal(0.0, 0.004, (800, 3))
    assert refusal(scale_fit((np.arange(800) * 10_000_000).astype(np.int64), steady)) == "motion"  # no rest at all
    assert refusal(scale_fit(*turn_stream(2, 1.4))) == "turns-mismatch"
    assert refusal(scale_fit(*turn_stream(2, 1.0), turns=2.0)) == "turns-mismatch"
    assert refusal(scale_fit(*turn_stream(2, 1.0), axis="x")) == "axis-mismatch"
    t_ns, gyro = turn_stream(2, 2.0, 4.0)
    assert refusal(scale_fit(t_ns, np.clip(gyro, -2.9, 2.9))) == "saturated"
    gap = t_ns.copy()
    gap[450:] += 3_000_000_000
    assert refusal(scale_fit(gap, gyro)) in {"not-turned", "turns-mismatch"}
    with pytest.raises(ValueError, match="turns must be given"):
        GyroScale(Options(unit="raw"))
