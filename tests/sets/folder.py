"""Writing a sensor folder of the `replay` contract from arrays.

Every reader of this package has a `write(shared_data, out, ...) -> Path`. The files carry what was recorded, turned
into FRD/NED, SI and gauss, with the stamps the recording gives: no filtering, no delay compensated by guess.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

AXES = ("x", "y", "z")
MS_NS = 1_000_000
GAUSS_PER_MILLIGAUSS = 1e-3
HALF_TURN_ABOUT_X = np.array([1.0, -1.0, -1.0])
"""Takes a vector from x forward, z up to forward, right, down, and from down back to up."""


def write_csv(out: Path, stem: str, t_ns: Ints, columns: Mapping[str, Floats]) -> None:
    """Write `stem`.csv with one row per stamp, in the order of `t_ns`; NaN becomes an empty cell."""
    out.mkdir(parents=True, exist_ok=True)
    order = np.argsort(t_ns, kind="stable")
    cells = [[str(t) for t in t_ns[order].tolist()]]
    cells += [["" if x != x else repr(x) for x in column[order].tolist()] for column in columns.values()]  # noqa: PLR0124
    lines = [",".join(("t_ns", *columns)), *map(",".join, zip(*cells, strict=True))]
    (out / f"{stem}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_imu(out: Path, t_ns: Ints, gyro_b_rad_s: Floats, accel_b_m_s2: Floats) -> None:
    """Write imu.csv from (N, 3) body rates and specific force, FRD."""
    columns = {f"gyro_{a}_rad_s": gyro_b_rad_s[:, i] for i, a in enumerate(AXES)}
    columns |= {f"accel_{a}_m_s2": accel_b_m_s2[:, i] for i, a in enumerate(AXES)}
    write_csv(out, "imu", t_ns, columns)


def write_mag(out: Path, t_ns: Ints, mag_b_gauss: Floats) -> None:
    """Write mag.csv from the (N, 3) field in FRD."""
    write_csv(out, "mag", t_ns, {f"mag_{a}_gauss": mag_b_gauss[:, i] for i, a in enumerate(AXES)})


def quat_columns(q_nb: Floats) -> dict[str, Floats]:
    """Name the columns of (N, 4) scalar-first quaternions."""
    return {f"q_{a}": q_nb[:, i] for i, a in enumerate(("w", *AXES))}


def velocity_columns(vel_n_m_s: Floats) -> dict[str, Floats]:
    """Name the columns of (N, 3) velocities, NED."""
    return {f"vel_{a}_m_s": vel_n_m_s[:, i] for i, a in enumerate(("n", "e", "d"))}


def position_columns(lla: Floats) -> dict[str, Floats]:
    """Name the columns of (N, 3) latitudes, longitudes (degrees) and altitudes (m)."""
    return {name: lla[:, i] for i, name in enumerate(("lat_deg", "lon_deg", "alt_m"))}


def velocity_from_course(speed_m_s: Floats, course_deg: Floats, vel_d_m_s: Floats) -> Floats:
    """Return (N, 3) NED velocities of a receiver that gives ground speed and course over ground."""
    course = np.radians(course_deg)
    return np.stack([speed_m_s * np.cos(course), speed_m_s * np.sin(course), vel_d_m_s], axis=1)


def quat_from_euler_deg(roll_pitch_yaw_deg: Floats) -> Floats:
    """Return (N, 4) scalar-first q_nb from roll, pitch, yaw in degrees (ZYX)."""
    turned = Rotation.from_euler("ZYX", roll_pitch_yaw_deg[:, ::-1], degrees=True)
    return np.ascontiguousarray(turned.as_quat(scalar_first=True))


def write_meta(out: Path, vehicle: str, **tables: Mapping[str, Any]) -> None:
    """Write meta.toml: the vehicle's class, then the given tables with numbers, lists of numbers or dates."""
    lines = ["[vehicle]", f'class = "{vehicle}"']
    for table, entries in tables.items():
        lines += [f"[{table}]", *(f"{key} = {value}" for key, value in entries.items())]
    out.mkdir(parents=True, exist_ok=True)
    (out / "meta.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
