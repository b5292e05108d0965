"""What any recording must obey, whoever wrote it down: reading a sensor folder back and the laws of motion as figures.

Nothing here uses the readers or the code under test: a wrong sign, axis, unit or clock in a written file shows.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tests.sets.folder import Floats, Ints

G_M_S2 = 9.8
EARTH_RADIUS_M = 6.37e6


class Table:
    """One csv file of a folder: stamps and columns by name."""

    def __init__(self, folder: Path, stem: str) -> None:
        header, *lines = (folder / f"{stem}.csv").read_text(encoding="utf-8").splitlines()
        cells = [line.split(",") for line in lines]
        self.t_ns: Ints = np.array([int(row[0]) for row in cells], np.int64)
        values = np.array([[float(cell or "nan") for cell in row[1:]] for row in cells])
        self.columns: dict[str, Floats] = dict(zip(header.split(",")[1:], values.T, strict=True))

    @property
    def t_s(self) -> Floats:
        """Stamps in seconds."""
        return np.asarray(self.t_ns * 1e-9, np.float64)

    def vectors(self, prefix: str, suffix: str, axes: str = "xyz") -> Floats:
        """Return (N, 3) from three columns `prefix_axis_suffix`."""
        return np.stack([self.columns[f"{prefix}_{axis}_{suffix}"] for axis in axes], axis=1)

    def known(self, column: str) -> np.ndarray:
        """Return which rows say something in a column."""
        return np.isfinite(self.columns[column])


def attitude(folder: Path) -> Slerp:
    """Return the reference attitude R_nb as a function of seconds."""
    reference = Table(folder, "reference")
    known = reference.known("q_w")
    q_nb = np.stack([reference.columns[f"q_{a}"][known] for a in "wxyz"], axis=1)
    return Slerp(reference.t_s[known], Rotation.from_quat(q_nb, scalar_first=True))


def within(slerp: Slerp, t_s: Floats) -> np.ndarray:
    """Return which stamps the reference spans."""
    return (t_s >= slerp.times[0]) & (t_s <= slerp.times[-1])


def gyro_against_reference_deg(folder: Path, window_s: float = 1.0) -> Floats:
    """Return angles, degrees: the gyro integrated over each window against the reference, less the median."""
    imu, R_nb = Table(folder, "imu"), attitude(folder)
    t_s, gyro = imu.t_s, imu.vectors("gyro", "rad_s")
    edges = np.arange(max(t_s[0], R_nb.times[0]), min(t_s[-1], R_nb.times[-1]), window_s)
    nearest = np.searchsorted(t_s, edges)
    rows = []
    for i, k in pairwise(nearest):
        steps = Rotation.from_rotvec(0.5 * (gyro[i + 1 : k + 1] + gyro[i:k]) * np.diff(t_s[i : k + 1])[:, None])
        turned = np.eye(3)
        for step in steps.as_matrix():
            turned = turned @ step
        if within(R_nb, t_s[[i, k]]).all():
            seen = R_nb(t_s[i]).inv() * R_nb(t_s[k])
            rows.append((Rotation.from_matrix(turned).inv() * seen).as_rotvec(degrees=True))
    errors = np.array(rows)
    return np.linalg.norm(errors - np.median(errors, axis=0), axis=1)


def field_n_gauss(folder: Path, start_s: float = -np.inf, end_s: float = np.inf) -> Floats:
    """Return the measured field turned into NED by the reference, shape (N, 3)."""
    mag, R_nb = Table(folder, "mag"), attitude(folder)
    chosen = within(R_nb, mag.t_s) & (mag.t_s >= start_s) & (mag.t_s < end_s)
    return R_nb(mag.t_s[chosen]).apply(mag.vectors("mag", "gauss")[chosen])


def rest_accel_n_m_s2(folder: Path) -> Floats:
    """Return the specific force turned into NED where neither rotation nor acceleration is felt, shape (N, 3)."""
    imu, R_nb = Table(folder, "imu"), attitude(folder)
    accel, gyro = imu.vectors("accel", "m_s2"), imu.vectors("gyro", "rad_s")
    still = (abs(np.linalg.norm(accel, axis=1) - G_M_S2) < 0.3) & (np.linalg.norm(gyro, axis=1) < 0.05)
    chosen = still & within(R_nb, imu.t_s)
    return R_nb(imu.t_s[chosen]).apply(accel[chosen])


def position_n_m(table: Table) -> tuple[Floats, Floats]:
    """Return stamps and NED positions, m, of the rows that have one."""
    known = table.known("lat_deg")
    lat, lon = np.radians(table.columns["lat_deg"][known]), np.radians(table.columns["lon_deg"][known])
    east = (lon - lon[0]) * np.cos(lat[0]) * EARTH_RADIUS_M
    return table.t_s[known], np.stack([(lat - lat[0]) * EARTH_RADIUS_M, east, -table.columns["alt_m"][known]], axis=1)


def velocity_n_m_s(table: Table) -> tuple[Floats, Floats]:
    """Return stamps and NED velocities of the rows that have one."""
    known = table.known("vel_n_m_s")
    return table.t_s[known], table.vectors("vel", "m_s", "ned")[known]


def running_integral(t_s: Floats, values: Floats) -> Floats:
    """Return the trapezoidal integral from the first stamp, same shape as `values`."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t_s).reshape(-1, *[1] * (values.ndim - 1))
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(steps, axis=0)])


def velocity_age_s(table: Table, span_s: float = 1.0) -> float:
    """Return how much older velocities are than positions of equal stamps: the one integrated against the other."""
    t_p, position = position_n_m(table)
    t_v, velocity = velocity_n_m_s(table)
    travelled = running_integral(t_v, velocity[:, :2])
    starts = np.arange(t_p[0] + 2.0, t_p[-1] - 2.0 - span_s, 0.5)

    def mismatch(age_s: float) -> float:
        moved = [_at(starts + span_s, t_p, position[:, i]) - _at(starts, t_p, position[:, i]) for i in (0, 1)]
        late = starts + age_s
        summed = [_at(late + span_s, t_v, travelled[:, i]) - _at(late, t_v, travelled[:, i]) for i in (0, 1)]
        return float(np.mean((np.array(moved) - np.array(summed)) ** 2))

    return lowest(mismatch, np.arange(-0.1, 0.42, 0.02))


def velocity_delay_s(folder: Path, span_s: float = 1.0) -> float:
    """Return how late the horizontal GNSS velocity is against the accelerometer turned by the reference attitude."""
    imu, R_nb = Table(folder, "imu"), attitude(folder)
    chosen = within(R_nb, imu.t_s)
    t_s = imu.t_s[chosen]
    gained = running_integral(t_s, R_nb(t_s).apply(imu.vectors("accel", "m_s2")[chosen])[:, :2])
    t_v, velocity = velocity_n_m_s(Table(folder, "gnss"))
    starts = np.arange(t_s[0] + 2.0, t_s[-1] - 2.0 - span_s, 0.2)
    seen = np.array([_at(starts + span_s, t_v, velocity[:, i]) - _at(starts, t_v, velocity[:, i]) for i in (0, 1)])

    def mismatch(delay_s: float) -> float:
        t = starts - delay_s
        felt = np.array([_at(t + span_s, t_s, gained[:, i]) - _at(t, t_s, gained[:, i]) for i in (0, 1)])
        return float(np.var(seen - felt, axis=1).sum())

    return lowest(mismatch, np.arange(-0.1, 0.62, 0.02))


def _at(t: Floats, t_s: Floats, values: Floats) -> Floats:
    return np.interp(t, t_s, values)


def lowest(cost: Callable[[float], float], grid: Floats) -> float:
    """Return where a parabola through the lowest three points of the grid has its bottom."""
    costs = np.array([cost(float(x)) for x in grid])
    i = int(np.clip(np.argmin(costs), 1, len(grid) - 2))
    a, b, _ = np.polyfit(grid[i - 1 : i + 2], costs[i - 1 : i + 2], 2)
    return float(-b / (2.0 * a))
