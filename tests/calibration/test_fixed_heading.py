"""One known attitude gives the hard iron, with a σ that holds; what is not known or not still is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.fixed_heading import MagFixedHeading, rotation_bn
from server.nav.calibration.types import Options
from server.nav.types import ROW_WIDTH, Kind

FIELD = np.array([0.21, 0.015, 0.44])
OFFSET = np.array([0.08, -0.05, 0.11])


def truth_nb(heading, pitch, roll):
    return Rotation.from_euler("ZYX", [heading, pitch, roll])


def stood(
    heading=1.0, pitch=0.05, roll=-0.08, told=None, seconds=6.0, seed=0, field=FIELD, rate=0.0, model=tuple(FIELD)
):
    """A collector that saw a vehicle stand at this attitude (by another library's rotation)."""
    rng = np.random.default_rng(seed)
    q_nb = truth_nb(heading, pitch, roll)
    count = int(seconds * 100)
    t_ns = np.arange(count, dtype=np.int64) * 10_000_000
    imu, mag = np.full((count, ROW_WIDTH), np.nan), np.full((count, ROW_WIDTH), np.nan)
    imu[:, :3] = rng.normal(size=(count, 3)) * 0.002 + rate * np.sin(np.arange(count) / 30.0)[:, None]
    imu[:, 3:6] = q_nb.inv().apply([0.0, 0.0, -9.81]) + rng.normal(size=(count, 3)) * 0.02
    mag[:, :3] = q_nb.inv().apply(field) + OFFSET + rng.normal(size=(count, 3)) * 0.002
    collector = MagFixedHeading(Options(heading_rad=heading if told is None else told, field_n_gauss=model))
    for at in range(0, count, 50):
        collector.feed(Kind.IMU, t_ns[at : at + 50], imu[at : at + 50])
        collector.feed(Kind.MAG, t_ns[at : at + 50], mag[at : at + 50])
    return collector


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.3, 0.0), (0.0, -0.3), (-0.2, 0.25)])
def test_the_offset_comes_back_at_any_heading_and_tilt(heading, pitch, roll):
    fit = stood(heading, pitch, roll).fit()
    assert fit.ok
    np.testing.assert_allclose(fit.parameters["offset"], OFFSET, atol=0.001)
    np.testing.assert_allclose(
        rotation_bn(truth_nb(heading, pitch, roll).inv().apply([0, 0, 1]), heading),
        truth_nb(heading, pitch, roll).inv().as_matrix(),
        atol=1e-12,
    )


def test_errors_of_heading_and_model_stay_within_three_sigma():
    z = []
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        field = Rotation.from_rotvec(rng.normal(size=3) * np.radians(1.0)).apply(FIELD) * (1 + 0.005 * rng.normal())
        heading = rng.uniform(-3, 3)
        fit = stood(
            heading,
            rng.normal() * 0.1,
            rng.normal() * 0.1,
            told=heading + rng.normal() * np.radians(2),
            seed=seed,
            field=field,
        ).fit()
        z.append((fit.parameters["offset"] - OFFSET) / fit.sigma["offset"])
    assert np.mean(np.abs(z) > 3.0) < 0.02
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"told": float("nan")}, "heading-unknown"),
        ({"model": ()}, "field-unknown"),
        ({"rate": 0.1}, "motion"),
        ({"pitch": 0.7}, "tilt"),
        ({"seconds": 0.1}, "too-few-samples"),
        ({"seconds": 0.0}, "no-data"),
    ],
)
def test_what_cannot_be_right_is_refused_with_its_reason(options, code):
    fit = stood(**options).fit()
    assert fit.failure.code == code
    assert not fit.parameters


def test_progress_reaches_its_end_after_five_seconds_at_rest():
    assert stood(seconds=2.5).progress().fraction == pytest.approx(0.5, abs=0.02)
    done = stood(seconds=6.0).progress()
    assert (done.fraction, done.is_complete, done.instruction) == (1.0, True, "done")


def test_a_lost_link_starts_the_rest_again():
    collector = stood(seconds=4.0)
    rows = np.full((1, ROW_WIDTH), 0.1)
    collector.feed(Kind.MAG, np.array([60_000_000_000]), rows)
    seen = collector.progress()
    assert (seen.restarts, seen.samples) == (1, 1)
    assert seen.fraction < 0.1


def test_verification_takes_the_offset_found_and_refuses_none():
    fit = stood(seed=1).fit()
    fresh = stood(seed=2)
    assert fresh.check(fit.parameters).ok
    nothing = fresh.check({"offset": np.zeros(3)})
    assert not nothing.ok
    assert nothing.residual.value == pytest.approx(np.linalg.norm(OFFSET), rel=0.02)


def test_counts_are_gauss_times_the_told_strength_and_need_it():
    with pytest.raises(ValueError, match="strength must be given"):
        MagFixedHeading(Options(heading_rad=0.0, field_n_gauss=tuple(FIELD), unit="raw"))
    counts = 1090.0
    gauss = stood(0.7)
    strength = counts * float(np.linalg.norm(FIELD))
    raw = MagFixedHeading(Options(heading_rad=0.7, field_n_gauss=tuple(FIELD), unit="raw", strength=strength))
    rng = np.random.default_rng(0)
    count = 600
    t_ns = np.arange(count, dtype=np.int64) * 10_000_000
    imu, mag = np.full((count, ROW_WIDTH), np.nan), np.full((count, ROW_WIDTH), np.nan)
    q_nb = truth_nb(0.7, 0.05, -0.08)
    imu[:, :3] = rng.normal(size=(count, 3)) * 0.002
    imu[:, 3:6] = q_nb.inv().apply([0.0, 0.0, -9.81]) + rng.normal(size=(count, 3)) * 0.02
    mag[:, :3] = counts * (q_nb.inv().apply(FIELD) + OFFSET + rng.normal(size=(count, 3)) * 0.002)
    for at in range(0, count, 50):
        raw.feed(Kind.IMU, t_ns[at : at + 50], imu[at : at + 50])
        raw.feed(Kind.MAG, t_ns[at : at + 50], mag[at : at + 50])
    fit = raw.fit()
    np.testing.assert_allclose(fit.parameters["offset"] / counts, OFFSET, atol=0.001)
    np.testing.assert_allclose(fit.sigma["offset"] / counts, gauss.fit().sigma["offset"], rtol=0.05)
    assert fit.residual_after.unit == "counts"
