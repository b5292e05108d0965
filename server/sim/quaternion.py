"""Rotations of the demo board in the hand: Hamilton quaternions [w, x, y, z] in rows, arrays of shape (…, 4)."""

from __future__ import annotations

import math

import numpy as np

from server.nav.types import Float


def product(p: Float, q: Float) -> Float:
    """Return p ⊗ q, row by row."""
    pw, px, py, pz = np.moveaxis(np.asarray(p), -1, 0)
    qw, qx, qy, qz = np.moveaxis(np.asarray(q), -1, 0)
    parts = (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )
    return np.stack(parts, axis=-1)


def turned(vector_rad: Float) -> Float:
    """Return Exp(vector) of rotation vectors, shape (…, 3) → (…, 4)."""
    half = 0.5 * np.asarray(vector_rad)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), half * np.sinc(angle / math.pi)], axis=-1)


def about(axis: int, angle_rad: Float) -> Float:
    """Return rotations about one axis by the given angles, shape (n,) → (n, 4)."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    q = np.zeros((*angle.shape, 4))
    q[..., 0], q[..., 1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return q


def inverse(q: Float) -> Float:
    """Return the opposite rotations."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def log(q: Float) -> Float:
    """Return the rotation vector of one quaternion, the short way round, shape (3,)."""
    w, v = float(q[0]), np.asarray(q[1:])
    sine = float(np.linalg.norm(v))
    if sine < 1e-12:
        return np.zeros(3)
    return np.asarray(v * (2.0 * math.atan2(math.copysign(sine, w), abs(w)) / sine))


def matrices(q: Float) -> Float:
    """Return R of unit quaternions, shape (n, 4) → (n, 3, 3)."""
    w, x, y, z = q.T
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def between(a: Float, b: Float) -> Float:
    """Return the smallest rotation vector, rad, that takes unit vector a to unit vector b, each of shape (3,)."""
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine > 1e-9:
        return np.asarray(axis * (math.atan2(sine, cosine) / sine))
    if cosine > 0.0:
        return np.zeros(3)
    side = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])  # any way is the shortest
    return np.asarray(side * (math.pi / np.linalg.norm(side)))
