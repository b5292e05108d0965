"""One static pose: what the accelerometer reads while the board is held, and how well its mean is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from server.nav.calibration.blocks import (
    B_AT_MAX,
    B_AT_MIN,
    B_FIRST,
    B_GYROS,
    B_MAX,
    B_MEAN,
    B_MIN,
    B_N,
    B_T0,
    B_T1,
    B_TEMPERATURE,
    B_VAR,
)
from server.nav.calibration.statistics import mean_known, mean_sigma, weighted_mean, with_resolution
from server.nav.calibration.stillness import block_std
from server.nav.types import Float

STIRRED: Final = 2.5  # times the median: an eighth of a percent of white noise in three axes of four samples
FEW_SAMPLES: Final = 10  # below, the own scatter of a pose is not worth much


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """One still run, its first and last block left out.

    Attributes:
        accel, gyro: shape (3,), mean in the unit of the data; gyro NaN without one.
        sigma: shape (3,), 1σ of the mean accelerometer.
        std: shape (3,), scatter of its samples.
        low, high: shape (3,), extreme values, and `at_low`, `at_high` the samples exactly there.
        t0_ns, t1_ns, first: board time, and the number of its first sample in the stream.
    """

    accel: Float
    gyro: Float
    sigma: Float
    std: Float
    low: Float
    high: Float
    at_low: Float
    at_high: Float
    samples: int
    t0_ns: int
    t1_ns: int
    first: int
    temperature_degc: float


def _extreme(values: Float, counts: Float, pick: np.ufunc) -> tuple[Float, Float]:
    best = pick.reduce(values, axis=0)
    return best, np.where(values == best, counts, 0.0).sum(axis=0)


def pose_of(blocks: Float) -> Pose:
    """Return the pose that these blocks are."""
    n = blocks[:, B_N]
    mean, var = blocks[:, B_MEAN : B_MEAN + 6], blocks[:, B_VAR : B_VAR + 6]
    with_gyro = blocks[:, B_GYROS] > 0.0
    gyro = weighted_mean(mean[with_gyro, :3], blocks[with_gyro, B_GYROS]) if with_gyro.any() else np.full(3, np.nan)
    low, at_low = _extreme(blocks[:, B_MIN + 3 : B_MIN + 6], blocks[:, B_AT_MIN + 3 : B_AT_MIN + 6], np.minimum)
    high, at_high = _extreme(blocks[:, B_MAX + 3 : B_MAX + 6], blocks[:, B_AT_MAX + 3 : B_AT_MAX + 6], np.maximum)
    return Pose(
        accel=weighted_mean(mean[:, 3:], n),
        gyro=gyro,
        sigma=mean_sigma(mean[:, 3:], var[:, 3:], n),
        std=np.sqrt(weighted_mean(var[:, 3:], n)),
        low=low,
        high=high,
        at_low=at_low,
        at_high=at_high,
        samples=int(n.sum()),
        t0_ns=int(blocks[0, B_T0]),
        t1_ns=int(blocks[-1, B_T1]),
        first=int(blocks[0, B_FIRST]),
        temperature_degc=mean_known(blocks[:, B_TEMPERATURE]),
    )


def rounded(pose: Pose, step: float) -> Pose:
    """Return the pose with the rounding of the sensor in its 1σ."""
    return replace(pose, sigma=with_resolution(pose.sigma, pose.std, step))


def with_common_noise(poses: Sequence[Pose]) -> list[Pose]:
    """Return poses of few samples with the noise that all of them show together; NaN where none shows any.

    One sample shows no scatter, two or three show it badly: their 1σ is at least that of the pooled scatter.
    """
    freedom = float(sum(pose.samples - 1 for pose in poses))
    power = sum(((pose.samples - 1) * pose.std**2 for pose in poses), np.zeros(3))
    common = np.sqrt(power / freedom) if freedom > 0.0 else np.full(3, np.nan)
    few = [pose.samples < FEW_SAMPLES for pose in poses]
    least = [np.maximum(pose.sigma, common / np.sqrt(pose.samples)) for pose in poses]
    return [
        replace(pose, sigma=sigma) if is_few else pose for pose, sigma, is_few in zip(poses, least, few, strict=True)
    ]


def stir_of(blocks: Float) -> float:
    """Return the RMS over three axes of the samples about their mean."""
    n, mean = blocks[:, B_N], blocks[:, B_MEAN + 3 : B_MEAN + 6]
    spread = blocks[:, B_VAR + 3 : B_VAR + 6] + (mean - weighted_mean(mean, n)) ** 2
    return float(np.sqrt(weighted_mean(spread, n).mean()))


def joined(table: Float, runs: Sequence[tuple[int, int]], near: float) -> list[Float]:
    """Return the blocks of each pose without its ends; neighbours alike are joined."""
    out: list[Float] = []
    for a, b in runs:
        blocks = quiet_part(table[a + 1 : b - 1])
        if out and np.linalg.norm(mean_of(out[-1]) - mean_of(blocks)) <= near:
            out[-1] = np.concatenate([out[-1], blocks])
        else:
            out.append(blocks)
    return out


def mean_of(blocks: Float) -> Float:
    """Return the mean specific force of the blocks, shape (3,)."""
    return weighted_mean(blocks[:, B_MEAN + 3 : B_MEAN + 6], blocks[:, B_N])


def quiet_part(blocks: Float) -> Float:
    """Return the blocks without those that a bump or the edge of a move stirred, judged by the pose's own median."""
    std = block_std(blocks, 3)
    mean = blocks[:, B_MEAN + 3 : B_MEAN + 6]
    away = np.linalg.norm(mean - np.median(mean, axis=0), axis=1)
    keep = (std <= STIRRED * np.median(std)) & (away <= STIRRED * np.median(away) / 0.6)
    return blocks[keep] if keep.any() else blocks
