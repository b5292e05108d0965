"""UMN's PX4 fixed wing, flight 9 (17 April 2017, Minnesota): its log's estimates, airspeed and receiver as csv tables.

The set has NO raw inertial sensor, magnetometer or barometer, so there is no imu.csv, mag.csv or baro.csv: replay runs
its pass-through lanes. The body rates of `vehicle_attitude` are the autopilot's filtered ones, and without specific
force they are no IMU. reference.csv holds the autopilot's attitude, and its position and velocity, at their own stamps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.sets import folder
from tests.sets.folder import Floats, Ints

DATE = "2017-04-17"


def load(shared_data: Path, table: str) -> dict[str, Floats]:
    """Return the columns of one table, as recorded."""
    path = shared_data / "umn_proto_flt09" / f"Proto_FLT09_{table}_0.csv"
    names, *lines = path.read_text(encoding="utf-8").splitlines()
    return dict(zip(names.split(","), np.loadtxt(lines, delimiter=",").T, strict=True))


def stamps_ns(columns: dict[str, Floats]) -> Ints:
    """Return the boot microseconds of a table as whole nanoseconds."""
    return np.round(columns["timestamp"]).astype(np.int64) * 1000


def stack(columns: dict[str, Floats], *names: str) -> Floats:
    """Return the named columns side by side."""
    return np.stack([columns[name] for name in names], axis=1)


def write(shared_data: Path, out: Path) -> Path:
    """Write the sensor folder of the flight and return it."""
    _write_airspeed(shared_data, out)
    _write_gnss(shared_data, out)
    _write_reference(shared_data, out)
    folder.write_meta(out, "fixed_wing", site={"date": DATE})
    return out


def _write_airspeed(shared_data: Path, out: Path) -> None:
    """Write the differential pressure and the true airspeed, each at its own stamps."""
    pressure, airspeed = load(shared_data, "differential_pressure"), load(shared_data, "airspeed")
    t_p, t_a = stamps_ns(pressure), stamps_ns(airspeed)
    t_ns = np.union1d(t_p, t_a)
    columns = {"diff_pressure_pa": np.full(len(t_ns), np.nan), "tas_m_s": np.full(len(t_ns), np.nan)}
    columns["diff_pressure_pa"][np.searchsorted(t_ns, t_p)] = pressure["differential_pressure_raw_pa"]
    columns["tas_m_s"][np.searchsorted(t_ns, t_a)] = airspeed["true_airspeed_unfiltered_m_s"]
    folder.write_csv(out, "airspeed", t_ns, columns)


def _write_gnss(shared_data: Path, out: Path) -> None:
    fixes = load(shared_data, "vehicle_gps_position")
    lla = stack(fixes, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3]
    columns = folder.position_columns(lla)
    columns |= folder.velocity_columns(stack(fixes, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s"))
    columns |= {"h_acc_m": fixes["eph"], "v_acc_m": fixes["epv"], "s_acc_m_s": fixes["s_variance_m_s"]}
    folder.write_csv(out, "gnss", stamps_ns(fixes), columns | {"fix_type": fixes["fix_type"]})


def _write_reference(shared_data: Path, out: Path) -> None:
    """Write attitude rows and position rows; what a row does not say is empty."""
    attitude, position = load(shared_data, "vehicle_attitude"), load(shared_data, "vehicle_global_position")
    t_att, t_pos = stamps_ns(attitude), stamps_ns(position)
    t_ns = np.union1d(t_att, t_pos)
    rows = np.full((len(t_ns), 10), np.nan)
    rows[np.searchsorted(t_ns, t_att), :4] = stack(attitude, *(f"q[{i}]" for i in range(4)))
    motion = stack(position, "lat", "lon", "alt", "vel_n", "vel_e", "vel_d")
    rows[np.searchsorted(t_ns, t_pos), 4:] = motion
    columns = folder.quat_columns(rows[:, :4]) | folder.position_columns(rows[:, 4:7])
    folder.write_csv(out, "reference", t_ns, columns | folder.velocity_columns(rows[:, 7:10]))
