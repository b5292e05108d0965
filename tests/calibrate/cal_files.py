"""Calibration recordings written the plain way from a stated truth: nothing of the code under test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

G_M_S2 = 9.80665
# S0's own numbers (its eq. 3.4-3.8 and 3.11-3.14; gyro bias of its L3GD20 board).
S0_T = np.array([[0.9638, -0.0090, 0.0018], [0.0142, 0.9666, -0.0143], [-0.0132, 0.0047, 0.9801]])
S0_ACCEL_OFFSET = np.array([-0.0039, 0.0006, 0.0034])
S0_GYRO_BIAS = np.array([0.0093, -0.0128, -0.0056])
S0_MAG_CENTRE = np.array([-95.1101, 43.5575, -159.3139])
S0_MAG_RADII = np.array([495.5620, 473.6044, 459.2490])

Rows = NDArray[np.float64]


def write(path: Path, header: str, rows: Rows, t_ns: Sequence[int] | None = None) -> Path:
    """Write a CSV with Python's shortest decimals, t_ns first when there are stamps."""
    lines = [header]
    for k, row in enumerate(rows.tolist()):
        lines.append(",".join(([] if t_ns is None else [str(t_ns[k])]) + [repr(v) for v in row]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def stamps_ns(n: int, rate_hz: float) -> list[int]:
    return [round(k * 1e9 / rate_hz) for k in range(n)]


def sphere(n: int) -> Rows:
    """n directions spread evenly over the sphere (Fibonacci)."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def s0_sweep(rng: np.random.Generator, n: int = 1200, noise: float = 2.0) -> Rows:
    """S0's magnetometer in raw counts over the whole sphere."""
    return S0_MAG_CENTRE + sphere(n) * S0_MAG_RADII + rng.normal(0.0, noise, (n, 3))


def s0_poses(rng: np.random.Generator, down: Rows, rate_hz: float = 100.0) -> Rows:
    """Rows of gyro and accelerometer, SI: 4 s still in each pose and 1 s of turning between; S0's errors, white noise.

    `down` are unit directions in body axes along which gravity pulls: specific force is −g·down.
    """
    still, moving = round(4.0 * rate_hz), round(1.0 * rate_hz)
    rows = []
    for k, pose in enumerate(down):
        following = down[min(k + 1, len(down) - 1)]
        share = np.linspace(0.0, 1.0, moving)[:, None]
        path = (1.0 - share) * pose + share * following + np.sin(np.pi * share) * [0.31, 0.37, 0.29]
        directions = np.vstack([np.tile(pose, (still, 1)), path / np.linalg.norm(path, axis=1, keepdims=True)])
        force = -G_M_S2 * directions
        force[still:] += rng.normal(0.0, 1.0, (moving, 3))  # a hand
        gyro = np.zeros_like(force)
        gyro[still:] = 1.5
        rows.append(np.hstack([gyro, force]))
    whole = np.vstack(rows)
    raw = whole[:, 3:] @ np.linalg.inv(S0_T).T + S0_ACCEL_OFFSET + rng.normal(0.0, 0.02, (len(whole), 3))
    rates = whole[:, :3] + S0_GYRO_BIAS + rng.normal(0.0, 0.002, (len(whole), 3))
    return np.hstack([rates, raw])


FACES_DOWN = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=float)
IMU_HEADER = "t_ns,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
