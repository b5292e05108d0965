"""Sweeps with a known truth, and second methods, for the ellipsoid's tests."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

# S0's board: centre and half axes in raw counts.
S0_CENTRE = np.array([-95.1101, 43.5575, -159.3139])
S0_RADII = np.array([495.5620, 473.6044, 459.2490])


def uniform(rng, count):
    """Directions all over the sphere, shape (count, 3)."""
    given = rng.normal(size=(count, 3))
    return given / np.linalg.norm(given, axis=1, keepdims=True)


def hand_sweep(seed, count=2000, rate_hz=50.0, rate_rad_s=1.2):
    """Directions of a field seen from a hand that turns a board at a rate that wanders (1.5 s), shape (count, 3)."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-1.0 / (1.5 * rate_hz))
    rate, q_nb = np.zeros(3), Rotation.random(random_state=seed)
    field = np.array([0.2, 0.0, 0.45]) / np.hypot(0.2, 0.45)
    out = np.empty((count, 3))
    for i in range(count):
        rate = keep * rate + np.sqrt(1.0 - keep * keep) * rng.normal(size=3) * rate_rad_s
        q_nb = q_nb * Rotation.from_rotvec(rate / rate_hz)
        out[i] = q_nb.inv().apply(field)
    return out


def slow_noise(rng, count, steps, sigma):
    """First-order noise of each axis with this correlation time in samples, shape (count, 3)."""
    keep = np.exp(-1.0 / steps)
    out, now = np.empty((count, 3)), rng.normal(size=3) * sigma
    for i in range(count):
        out[i] = now
        now = keep * now + np.sqrt(1.0 - keep * keep) * rng.normal(size=3) * sigma
    return out


def ellipsoid(directions, offset, matrix):
    """Raw readings with matrix (raw − offset) = directions."""
    return directions @ np.linalg.inv(matrix).T + offset


def shape_of(matrix):
    """The matrix up to scale: of determinant 1."""
    return np.asarray(matrix) / np.linalg.det(matrix) ** (1.0 / 3.0)


def geometric_fit(xyz):
    """Second method: minimise Σ (|M (x − b)| − 1)² by Levenberg-Marquardt; returns offset, matrix."""
    centre = 0.5 * (xyz.max(axis=0) + xyz.min(axis=0))
    size = np.linalg.norm(xyz - centre, axis=1).mean()

    def matrix_of(p):
        return np.array([[p[3], p[6], p[7]], [p[6], p[4], p[8]], [p[7], p[8], p[5]]])

    def off(p):
        return np.linalg.norm(((xyz - centre) / size - p[:3]) @ matrix_of(p), axis=1) - 1.0

    p = least_squares(off, np.array([0, 0, 0, 1, 1, 1, 0, 0, 0.0]), method="lm", xtol=1e-12).x
    return centre + size * p[:3], matrix_of(p) / size


def s0_fit(xyz):
    """S0 (3.11-3.14): 6 parameters, x² = D w by least squares; returns the centre."""
    x, y, z = xyz.T
    w = np.linalg.lstsq(np.column_stack([x, y * y, y, z * z, z, np.ones(len(x))]), x * x, rcond=None)[0]
    return np.array([w[0] / 2.0, -w[2] / (2.0 * w[1]), -w[4] / (2.0 * w[3])])
