"""InertialNav's X8 flying wing near Melbourne (ArduPlane, November 2013): circuits, loops and rolls.

Stamps are the logger's milliseconds since boot (of a fix: when it was logged; by correlation its velocity and its
position are then 0.32 s old). The field is the autopilot's, with the offsets it logs beside it already added, which
drift as it learns; `raw_mag=True` takes them off. The airspeed is sqrt(ARSPD_RATIO · pressure): an indicated one,
within one percent of the true one at these heights but for the ratio. Baro altitude is relative to the start, GNSS
altitude above the sea. There are no receiver accuracies.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from tests.sets import folder
from tests.sets.folder import GAUSS_PER_MILLIGAUSS, MS_NS, Floats, Ints

DATE = "2013-11-29"
ROLL_MAX_DEG, PITCH_MAX_DEG = 60.0, 45.0
SETTLE_S = 5.0


def load(shared_data: Path) -> dict[str, Floats]:
    """Return table name to a mapping-like array: column name to values, as `table.column` keys."""
    recorded: dict[str, Any] = loadmat(shared_data / "inertialnav_x8" / "TestLog2.mat")
    columns = {}
    for name in ("IMU", "ATT", "MAG", "GPS", "NTUN"):
        labels = [str(cell.item()) for cell in recorded[f"{name}_label"].ravel()]
        columns |= {f"{name}.{label}": recorded[name][:, i].astype(np.float64) for i, label in enumerate(labels)}
    return columns


def stack(columns: dict[str, Floats], table: str, *names: str) -> Floats:
    """Return the named columns of a table side by side."""
    return np.stack([columns[f"{table}.{name}"] for name in names], axis=1)


def stamps_ns(column_ms: Floats) -> Ints:
    """Return milliseconds as whole nanoseconds."""
    return np.round(column_ms).astype(np.int64) * MS_NS


def aerobatics_ns(shared_data: Path, settle_s: float = SETTLE_S) -> list[tuple[int, int]]:
    """Return [start, end) stamps to leave out: steep attitudes, with `settle_s` before and after them."""
    columns = load(shared_data)
    steep = (abs(columns["ATT.Roll"]) > ROLL_MAX_DEG) | (abs(columns["ATT.Pitch"]) > PITCH_MAX_DEG)
    margin_ns, intervals = round(settle_s * 1e9), list[tuple[int, int]]()
    for t_ns in stamps_ns(columns["ATT.TimeMS"])[steep].tolist():
        if intervals and t_ns - margin_ns <= intervals[-1][1]:
            intervals[-1] = (intervals[-1][0], t_ns + margin_ns)
        else:
            intervals.append((t_ns - margin_ns, t_ns + margin_ns))
    return intervals


def write(shared_data: Path, out: Path, raw_mag: bool = False) -> Path:
    """Write the sensor folder of the flight and return it."""
    columns = load(shared_data)
    t_ns = {name: stamps_ns(columns[f"{name}.TimeMS"]) for name in ("IMU", "ATT", "MAG", "NTUN")}
    folder.write_imu(
        out, t_ns["IMU"], stack(columns, "IMU", "GyrX", "GyrY", "GyrZ"), stack(columns, "IMU", "AccX", "AccY", "AccZ")
    )
    mag = stack(columns, "MAG", "MagX", "MagY", "MagZ") - raw_mag * stack(columns, "MAG", "OfsX", "OfsY", "OfsZ")
    folder.write_mag(out, t_ns["MAG"], mag * GAUSS_PER_MILLIGAUSS)
    folder.write_csv(out, "baro", t_ns["NTUN"], {"altitude_m": columns["NTUN.Alt"]})
    folder.write_csv(out, "airspeed", t_ns["NTUN"], {"tas_m_s": columns["NTUN.Arspd"]})
    attitude = folder.quat_from_euler_deg(stack(columns, "ATT", "Roll", "Pitch", "Yaw"))
    folder.write_csv(out, "reference", t_ns["ATT"], folder.quat_columns(attitude))
    _write_gnss(columns, out)
    folder.write_meta(out, "fixed_wing", site={"date": DATE})
    return out


def _write_gnss(columns: dict[str, Floats], out: Path) -> None:
    """Write the fixes at the time they were logged, one row for one time of week."""
    fresh = np.diff(columns["GPS.TimeMS"], prepend=-1.0) != 0.0
    lla = stack(columns, "GPS", "Lat", "Lng", "Alt")[fresh]
    speed, course, vz = (columns[f"GPS.{name}"][fresh] for name in ("Spd", "GCrs", "VZ"))
    velocity = folder.velocity_columns(folder.velocity_from_course(speed, course, vz))
    fixes = folder.position_columns(lla) | velocity | {"fix_type": columns["GPS.Status"][fresh]}
    folder.write_csv(out, "gnss", stamps_ns(columns["GPS.T"][fresh]), fixes)
