"""Airspeed zero and barometer reference: recovery, sigma, the standard atmosphere, refusals."""

import numpy as np
import pytest

from server.nav.calibration.steady import CAPACITY, Steady
from server.nav.calibration.types import Options
from server.nav.calibration.zero import AirspeedZero, BaroReference
from server.nav.types import ROW_WIDTH, Float, Int, Kind


def rows_of(column: int, values: Float) -> Float:
    out = np.full((len(values), ROW_WIDTH), np.nan)
    out[:, column] = values
    return out


def stamps(n: int, rate_hz: float) -> Int:
    return np.round(np.arange(n) / rate_hz * 1e9).astype(np.int64)


def test_the_pitot_zero_comes_back_within_three_sigma() -> None:
    z = []
    for seed in range(60):
        collector = AirspeedZero(Options())
        values = 37.5 + np.random.default_rng(seed).normal(0.0, 2.0, 300)
        collector.feed(Kind.AIRSPEED, stamps(300, 50.0), rows_of(0, values))
        fit = collector.fit()
        z.append((float(fit.parameters["bias"]) - 37.5) / float(fit.sigma["bias"]))
        assert collector.check(fit.parameters).ok
    assert np.max(np.abs(z)) < 4.0
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_wind_and_an_impossible_pressure_are_refused() -> None:
    rng = np.random.default_rng(1)
    for values, code in (
        (40.0 + 60.0 * np.sin(np.arange(300) / 40.0), "airflow"),
        (3000.0 + rng.normal(0.0, 1.0, 300), "out-of-range"),
        (np.full(300, np.nan), "no-data"),
        (np.full(5, 3.0), "too-few-samples"),
    ):
        collector = AirspeedZero(Options())
        collector.feed(Kind.AIRSPEED, stamps(len(values), 50.0), rows_of(0, values))
        failed = collector.fit().failure
        assert failed is not None
        assert failed.code == code


@pytest.mark.parametrize("height_m", [float("nan"), 250.0])
def test_the_barometer_reads_the_told_height_afterwards(height_m: float) -> None:
    collector = BaroReference(Options(height_m=height_m))
    pressure = 95000.0 + np.random.default_rng(2).normal(0.0, 3.0, 100)
    collector.feed(Kind.BARO, stamps(100, 10.0), rows_of(0, pressure))
    fit = collector.fit()
    shown = 44330.8 * (1.0 - (95000.0 / 101325.0) ** 0.19026) - float(fit.parameters["bias"])  # S0 (3.27)
    assert shown == pytest.approx(0.0 if np.isnan(height_m) else height_m, abs=0.2)
    assert fit.details["reference_pa"] == pytest.approx(95000.0, abs=2.0)


def test_climbing_and_an_impossible_pressure_are_refused() -> None:
    t_ns = stamps(100, 10.0)
    for values, code in ((95000.0 - 12.0 * np.arange(100), "motion"), (np.full(100, 950.0), "out-of-range")):
        collector = BaroReference(Options())
        collector.feed(Kind.BARO, t_ns, rows_of(0, values))
        failed = collector.fit().failure
        assert failed is not None
        assert failed.code == code


@pytest.mark.parametrize("step", [1, 9])
def test_cuts_change_no_bit_and_a_hole_starts_again(step: int) -> None:
    values = 12.0 + np.random.default_rng(3).normal(0.0, 1.0, 400)
    t_ns = stamps(400, 50.0)
    t_ns[150:] += 9_000_000_000
    rows = rows_of(0, values)
    rows[200:210] = np.nan
    whole, cut = AirspeedZero(Options()), AirspeedZero(Options())
    whole.feed(Kind.AIRSPEED, t_ns, rows)
    for at in range(0, 400, step):
        cut.feed(Kind.AIRSPEED, t_ns[at : at + step], rows[at : at + step])
    assert whole.fit().parameters == cut.fit().parameters
    assert whole.progress().restarts == cut.progress().restarts == 1
    assert float(whole.fit().parameters["bias"]) == pytest.approx(np.nanmean(rows[150:, 0]), abs=1e-12)


def test_only_the_newest_are_kept_however_they_came() -> None:
    n = 2 * CAPACITY + 77
    rows, t_ns = rows_of(0, np.arange(float(n))), stamps(n, 50.0)
    for step in (n, 30_011):
        steady = Steady(Kind.AIRSPEED)
        for at in range(0, n, step):
            steady.feed(Kind.AIRSPEED, t_ns[at : at + step], rows[at : at + step])
        times, values = steady.column(0)
        assert len(steady) == CAPACITY
        assert times.tobytes() == t_ns[-CAPACITY:].tobytes()
        assert (values[0], values[-1]) == (n - CAPACITY, n - 1)


def test_counts_of_a_pressure_sensor_are_not_judged_in_pascal() -> None:
    collector = AirspeedZero(Options(unit="raw"))
    values = 8192.0 + np.random.default_rng(3).normal(0.0, 40.0, 300)
    collector.feed(Kind.AIRSPEED, stamps(300, 50.0), rows_of(0, values))
    fit = collector.fit()
    assert float(fit.parameters["bias"]) == pytest.approx(values.mean(), rel=1e-12)
    assert fit.residual_after is not None
    assert (fit.grade, fit.residual_after.unit) == ("fair", "counts")
    assert collector.check(fit.parameters).ok
    assert not collector.check({"bias": 9000.0}).ok
