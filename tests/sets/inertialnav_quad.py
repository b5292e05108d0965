"""InertialNav's two ArduCopter flights near Melbourne in August 2014, as text columns.

Stamps are the logger's milliseconds, GNSS as logged: its delay is the receiver's and the logger's, and unknown. Found
by correlation with the accelerometer, the velocity is 0.26 s late and 0.10 s older than the position beside it (106);
the slow flight 123 says the same less sharply. The accelerometer and gyro are the autopilot's (its start-up gyro offset
already taken off). The logged magnetometer offsets are all zero; the field fits Earth's, so offsets were taken off on
board or are small. The text kept eight digits: latitude to 1e-6° (0.11 m), longitude to 1e-5° (0.88 m). There are no
receiver accuracies. Heights are relative to home. The southern field points up.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np

from tests.sets import folder
from tests.sets.folder import GAUSS_PER_MILLIGAUSS, MS_NS, Floats, Ints

FLIGHTS = (106, 123)
DATES = {106: "2014-08-02", 123: "2014-08-17"}


def load(shared_data: Path, flight: int, table: str) -> Floats:
    """Return one table of a flight (IMU, MAG, ATT, NTUN, GPS) as recorded."""
    with zipfile.ZipFile(shared_data / "inertialnav_quad" / f"quad{flight}.zip") as archive:
        return np.loadtxt(io.BytesIO(archive.read(f"{table}.txt")))


def stamps_ns(column_ms: Floats) -> Ints:
    """Return milliseconds as whole nanoseconds."""
    return np.round(column_ms).astype(np.int64) * MS_NS


def write(shared_data: Path, out: Path, flight: int) -> Path:
    """Write the sensor folder of one flight (`FLIGHTS`) and return it."""
    imu, mag, att, ntun, gps = (load(shared_data, flight, name) for name in ("IMU", "MAG", "ATT", "NTUN", "GPS"))
    folder.write_imu(out, stamps_ns(imu[:, 1]), imu[:, 2:5], imu[:, 5:8])
    folder.write_mag(out, stamps_ns(mag[:, 1]), mag[:, 2:5] * GAUSS_PER_MILLIGAUSS)
    folder.write_csv(out, "baro", stamps_ns(ntun[:, 1]), {"altitude_m": ntun[:, 8]})
    folder.write_csv(
        out, "reference", stamps_ns(att[:, 1]), folder.quat_columns(folder.quat_from_euler_deg(att[:, 2:5]))
    )
    velocity = folder.velocity_columns(folder.velocity_from_course(gps[:, 10], gps[:, 11], gps[:, 12]))
    fixes = folder.position_columns(gps[:, 6:9]) | velocity | {"fix_type": gps[:, 1]}
    folder.write_csv(out, "gnss", stamps_ns(gps[:, 2]), fixes)
    folder.write_meta(out, "multirotor", site={"date": DATES[flight]})
    return out
