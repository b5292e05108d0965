"""Level: the rotation that makes gravity vertical; known angles, sigma, refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.level import Level
from server.nav.calibration.types import Options
from server.nav.types import Float, Kind
from tests.calibration.imu_made import GRAVITY, table


def levelled(accel: Float, noise: float = 0.02, seed: int = 0, n: int = 500) -> Level:
    """Return a collector that saw a board at rest with this mean reading for 5 s."""
    rows = np.asarray(accel) + np.random.default_rng(seed).normal(0.0, noise, (n, 3))
    collector = Level(Options())
    collector.feed(Kind.IMU, (np.arange(n) * 10_000_000).astype(np.int64), table(np.zeros((n, 3)), rows, n))
    return collector


def seen_at(roll_deg: float, pitch_deg: float) -> Float:
    """Return the specific force of a level vehicle in the axes of a board mounted with this roll and pitch (ZYX)."""
    R_vb = Rotation.from_euler("ZYX", [0.0, pitch_deg, roll_deg], degrees=True)
    return np.asarray(R_vb.inv().apply([0.0, 0.0, -GRAVITY]))


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 0.0), (3.0, -5.0), (-8.0, 9.0)])
def test_the_mounting_comes_back_within_three_sigma(roll_deg: float, pitch_deg: float) -> None:
    z = []
    for seed in range(30):
        collector = levelled(seen_at(roll_deg, pitch_deg), seed=seed)
        fit = collector.fit()
        z.append((fit.details["roll_rad"] - np.radians(roll_deg)) / fit.details["roll_sigma_rad"])
        z.append((fit.details["pitch_rad"] - np.radians(pitch_deg)) / fit.details["pitch_sigma_rad"])
        truth = Rotation.from_euler("ZYX", [0.0, pitch_deg, roll_deg], degrees=True).as_matrix()
        np.testing.assert_allclose(fit.parameters["matrix"], truth, atol=1e-3)
        entries = (np.asarray(fit.parameters["matrix"]) - truth) / fit.sigma["matrix"]
        assert np.isnan(entries[1, 0])  # 0 by definition, not by measurement
        assert np.nanmax(np.abs(entries)) < 4.5
        assert collector.check(fit.parameters).ok
    assert np.mean(np.abs(z) > 3.0) <= 0.05
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5


def test_too_much_tilt_motion_and_a_wrong_unit_are_refused() -> None:
    codes = []
    for collector in (
        levelled(seen_at(20.0, 0.0)),
        levelled(seen_at(0.0, 0.0), noise=3.0),
        levelled(seen_at(0.0, 0.0) / GRAVITY),
        levelled([0.0, 0.0, GRAVITY]),
        levelled(seen_at(0.0, 0.0), n=0),
    ):
        failed = collector.fit().failure
        codes.append("" if failed is None else failed.code)
    assert codes == ["tilt", "motion", "gravity", "tilt", "no-data"]


def test_a_board_that_was_levelled_otherwise_fails_the_check() -> None:
    assert not levelled(seen_at(4.0, 0.0)).check({"matrix": np.eye(3)}).ok
