"""BROAD (Laidig et al. 2021): an inertial sensor in the hand, filmed by an optical system; no GNSS, no site.

The sensor's z axis points up; the half turn about its x axis makes it FRD, for gyro, accelerometer and magnetometer
alike. `opt_quat` is sensor to ENU, whose north is that of the laboratory's field. The rows where the cameras lost the
markers are left out of reference.csv. The clock is the sample number over the sampling rate (2000/7 Hz), common to all.
Only the rows that `movement` marks count for a score.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from tests.sets import folder
from tests.sets.folder import HALF_TURN_ABOUT_X, Floats, Ints

TRIALS = (1, 6, 10, 15, 21, 28, 33, 36)
GAUSS_PER_MICROTESLA = 0.01
NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def load(shared_data: Path, trial: int) -> dict[str, Any]:
    """Return the arrays of one trial as recorded."""
    (path,) = (shared_data / "broad").glob(f"{trial:02d}_*.mat")
    return dict(loadmat(path))


def stamps_ns(recorded: dict[str, Any]) -> Ints:
    """Return the stamps of all samples, from 0."""
    period_ns = 1e9 / float(recorded["sampling_rate"].item())
    return np.round(np.arange(len(recorded["imu_gyr"])) * period_ns).astype(np.int64)


def quat_nb(opt_quat: Floats) -> Floats:
    """Return (N, 4) q_nb, body FRD to NED, from sensor to ENU; rows without NaN."""
    R_enu_s = Rotation.from_quat(opt_quat, scalar_first=True)
    turned = Rotation.from_matrix(NED_FROM_ENU) * R_enu_s * Rotation.from_matrix(np.diag(HALF_TURN_ABOUT_X))
    return np.ascontiguousarray(turned.as_quat(scalar_first=True))


def movement(shared_data: Path, trial: int) -> tuple[Ints, np.ndarray[Any, np.dtype[np.bool_]]]:
    """Return the stamps of all samples and whether each counts for the score (the motion phase)."""
    recorded = load(shared_data, trial)
    return stamps_ns(recorded), recorded["movement"].ravel().astype(bool)


def write(shared_data: Path, out: Path, trial: int) -> Path:
    """Write the sensor folder of one trial (`TRIALS`) and return it."""
    recorded = load(shared_data, trial)
    t_ns = stamps_ns(recorded)
    folder.write_imu(out, t_ns, recorded["imu_gyr"] * HALF_TURN_ABOUT_X, recorded["imu_acc"] * HALF_TURN_ABOUT_X)
    folder.write_mag(out, t_ns, recorded["imu_mag"] * HALF_TURN_ABOUT_X * GAUSS_PER_MICROTESLA)
    seen = np.isfinite(recorded["opt_quat"]).all(axis=1)
    folder.write_csv(out, "reference", t_ns[seen], folder.quat_columns(quat_nb(recorded["opt_quat"][seen])))
    folder.write_meta(out, "hand_held")
    return out
