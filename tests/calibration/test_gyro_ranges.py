"""Turns whose samples somebody named: the plain sum over them, whatever lies around; rests are found or named."""

from collections.abc import Sequence

import numpy as np
import pytest

from server.nav.calibration.gyro_scale import GyroScale
from server.nav.calibration.types import Fit, Options
from server.nav.types import Float, Int
from tests.calibration.imu_made import S0_BIAS, UP, Made, table

TURN = 2.0 * np.pi
SCALE = 1.02
COUNTS = 7506.0  # a rad/s at 131 counts a degree per second


def session(turns: Sequence[tuple[int, float]], seed: int = 0) -> tuple[Int, Float, list[tuple[int, int]]]:
    """Return stamps, raw rates and the samples of each turn (axis, turns) of 5 s, rests of 2 s around."""
    made, marks = Made(rate_hz=100.0), []
    made.hold(UP[5], 2.0)
    for k, (axis, count) in enumerate(turns):
        marks.append((200 + 700 * k, 700 + 700 * k))
        made.turn(axis, TURN * count, 5.0, UP[5])
        made.hold(UP[5], 2.0)
    t_ns, _, rate = made.stream()
    return t_ns, rate / SCALE + S0_BIAS + np.random.default_rng(seed).normal(0.0, 0.004, rate.shape), marks


def fitted(t_ns: Int, gyro: Float, ranges: Sequence[tuple[int, int]], **options: object) -> Fit:
    collector = GyroScale(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    return collector.fit_ranges(t_ns, table(gyro, None, len(t_ns)), ranges)


def scale_by_sum(gyro: Float, turn: tuple[int, int], rest: slice, axis: int) -> float:
    """Return S1 (3.11) by plain arithmetic at 100 Hz."""
    angle = np.sum(gyro[turn[0] : turn[1], axis] - gyro[rest, axis].mean()) / 100.0
    return float(TURN / abs(angle))


@pytest.mark.parametrize(("first", "end"), [(200, 700), (150, 760), (240, 640)])
def test_a_turn_is_the_sum_over_exactly_its_samples_also_when_they_are_cut_short(first: int, end: int) -> None:
    t_ns, gyro, _ = session([(0, 1.0)])
    for ranges in ([(first, end)], [(0, 140), (first, end)], [(first, end), (0, 140)]):
        fit = fitted(t_ns, gyro, ranges, turns=1.0)
        rest = slice(0, 140) if len(ranges) > 1 else slice(0, 150)
        expected = scale_by_sum(gyro, (first, end), rest, 0)
        assert np.asarray(fit.parameters["scale"])[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("unit", ["si", "raw"])
@pytest.mark.parametrize("named", [[0, 1], [0, 1, 2, 3], [2, 3]])
def test_several_turns_without_a_named_rest_are_all_turns(unit: str, named: list[int]) -> None:
    """The longest steady rate of the stream is one of the double turns that nobody named."""
    t_ns, gyro, marks = session([(0, 1.0), (0, -1.0), (1, 1.0), (2, -1.0), (1, 2.0), (1, -2.0)])
    factor, options = (1.0, {}) if unit == "si" else (COUNTS, {"unit": "raw", "turns": 1.0})
    fit = fitted(t_ns, np.round(gyro * factor) if unit == "raw" else gyro, [marks[k] for k in named], **options)
    scale = np.asarray(fit.parameters["scale"]) * factor
    axes = sorted({0 if k < 2 else k - 1 for k in named})
    np.testing.assert_allclose(scale[axes], SCALE, rtol=0.002)
    assert np.isnan(np.delete(np.asarray(fit.sigma["scale"]), axes)).all()
    np.testing.assert_allclose(np.asarray(fit.parameters["bias"]) / factor, S0_BIAS, atol=0.001)


def test_a_steady_turn_without_any_rest_has_the_sigma_of_an_unknown_bias() -> None:
    rng = np.random.default_rng(3)
    t_ns = (np.arange(400) * 10_000_000).astype(np.int64)
    off = []
    for _ in range(40):
        bias = rng.normal(0.0, 0.01, 3)
        gyro = np.array([np.pi / 2.0, 0.0, 0.0]) / SCALE + bias + rng.normal(0.0, 0.004, (400, 3))
        fit = fitted(t_ns, gyro, [(0, 400)])
        off.append((np.asarray(fit.parameters["scale"])[0] - SCALE) / np.asarray(fit.sigma["scale"])[0])
        assert fit.grade != "good"
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.1
    counts = fitted(t_ns, gyro * COUNTS + 32768.0, [(0, 400)], unit="raw", turns=1.0)
    assert counts.failure is not None
    assert counts.failure.code == "motion"  # the zero of counts is not known, and nothing shows it


def test_named_rests_alone_and_a_turn_with_a_hole_are_refused() -> None:
    t_ns, gyro, marks = session([(0, 1.0)])
    rests = fitted(t_ns, gyro, [(0, 90), (100, 190)])
    assert rests.failure is not None
    assert rests.failure.code == "not-turned"
    holed = t_ns.copy()
    holed[450:] += 1_000_000_000
    fit = fitted(holed, gyro, marks)
    assert fit.failure is not None
    assert fit.failure.code == "not-turned"
