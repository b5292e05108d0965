"""Errors of a lane against the reference, at equal t_ns, with no fit of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from server.nav.constants import WGS84_A_M, WGS84_E2
from server.nav.types import LANE_COLUMNS, Float, Int
from server.replay.contract import CoverOut, ErrorsOut, OutageOut, SpreadOut
from server.replay.interpolate import MAX_GAP_NS, sampled

Stamps = Literal["lane stamps", "reference stamps"]

_SIGMA: Final = LANE_COLUMNS.index("sigma_att_x_rad")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """Lane minus reference, one row a stamp; NaN where either is unknown.

    Attributes:
        t_ns: shape (n,), ascending.
        rotation_n_rad: shape (n, 3), Log(q_lane ⊗ q_reference*), NED; its norm is the total angle, z is heading.
        position_m: shape (n, 3), north, east, up.
        velocity_n_m_s: shape (n, 3), NED.
        sigma: shape (n, 9), the lane's own: attitude NED rad, velocity NED m/s, position NED m.
    """

    stamps: Stamps
    t_ns: Int
    rotation_n_rad: Float
    position_m: Float
    velocity_n_m_s: Float
    sigma: Float

    def within(self, start_ns: int, stop_ns: int) -> Compared:
        """Return the rows with start_ns ≤ t_ns < stop_ns."""
        part = slice(*np.searchsorted(self.t_ns, [start_ns, stop_ns]))
        return Compared(
            stamps=self.stamps,
            t_ns=self.t_ns[part],
            rotation_n_rad=self.rotation_n_rad[part],
            position_m=self.position_m[part],
            velocity_n_m_s=self.velocity_n_m_s[part],
            sigma=self.sigma[part],
        )


def compare(t_ns: Int, lane: Float, reference_t_ns: Int, reference: Float) -> Compared:
    """Return lane minus reference.

    Compared at the lane's stamps with the reference interpolated, where the reference is frequent (median spacing at
    most MAX_GAP_NS), else at the reference's stamps with the lane interpolated; never across a larger gap.

    Args:
        t_ns: stamps of the lane's rows, ascending.
        lane: its rows, columns as in LANE_COLUMNS.
        reference_t_ns: stamps of the reference, ascending.
        reference: its rows, columns as in SAMPLE_COLUMNS[Kind.REFERENCE].
    """
    estimate = np.hstack([lane[:, :4], lane[:, 7:10], lane[:, 4:7], lane[:, _SIGMA : _SIGMA + 9]])
    truth = np.ascontiguousarray(reference[:, :10])
    if len(reference_t_ns) > 1 and np.median(np.diff(reference_t_ns)) <= MAX_GAP_NS:
        return _difference("lane stamps", t_ns, estimate, sampled(t_ns, reference_t_ns, truth))
    at_reference = sampled(reference_t_ns, t_ns, estimate)
    return _difference("reference stamps", reference_t_ns, at_reference, truth)


def _difference(stamps: Stamps, t_ns: Int, estimate: Float, truth: Float) -> Compared:
    return Compared(
        stamps=stamps,
        t_ns=t_ns,
        rotation_n_rad=rotation_between(estimate[:, :4], truth[:, :4]),
        position_m=_metres_between(estimate[:, 4:7], truth[:, 4:7]),
        velocity_n_m_s=estimate[:, 7:10] - truth[:, 7:10],
        sigma=estimate[:, 10:19],
    )


def rotation_between(q_nb: Float, q_nb_true: Float) -> Float:
    """Return Log(q_nb ⊗ q_nb_true*), shape (n, 3), rad, NED, of norm at most π [Solà 2017, eq. 105]."""
    w, v = q_nb[:, :1], q_nb[:, 1:]
    tw, tv = q_nb_true[:, :1], -q_nb_true[:, 1:]
    scalar = w * tw - (v * tv).sum(axis=1, keepdims=True)
    vector = w * tv + tw * v + np.cross(v, tv)
    vector = np.where(scalar < 0.0, -vector, vector)
    norm = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(norm, np.abs(scalar))
    return np.asarray(vector * np.where(norm > 0.0, angle / np.where(norm > 0.0, norm, 1.0), 2.0))


def _metres_between(lla: Float, lla_true: Float) -> Float:
    """Return north, east, up in m of one place from another nearby, both latitude, longitude in degrees and height."""
    lat_rad = np.radians(lla_true[:, 0])
    w2 = 1.0 - WGS84_E2 * np.sin(lat_rad) ** 2
    prime_m = WGS84_A_M / np.sqrt(w2)
    height_m = np.where(np.isfinite(lla_true[:, 2]), lla_true[:, 2], 0.0)
    turn_deg = np.remainder(lla[:, 1] - lla_true[:, 1] + 180.0, 360.0) - 180.0
    north_m = np.radians(lla[:, 0] - lla_true[:, 0]) * (prime_m * (1.0 - WGS84_E2) / w2 + height_m)
    east_m = np.radians(turn_deg) * (prime_m + height_m) * np.cos(lat_rad)
    return np.stack([north_m, east_m, lla[:, 2] - lla_true[:, 2]], axis=1)


def spread(values: Float) -> SpreadOut | None:
    """Return the size of the known values, or None when there are none."""
    known = np.abs(values[np.isfinite(values)])
    if not len(known):
        return None
    p50, p95, p99 = (float(p) for p in np.percentile(known, [50, 95, 99]))
    rms = float(np.sqrt(np.mean(known * known)))
    return SpreadOut(rows=len(known), rms=rms, p50=p50, p95=p95, p99=p99, max=float(known.max()))


def _cover(error: Float, sigma: Float) -> float | None:
    """Return the share of rows with every component inside its own 3σ, among those that know all of them."""
    known = np.isfinite(error).all(axis=1) & np.isfinite(sigma).all(axis=1)
    return float((np.abs(error[known]) <= 3.0 * sigma[known]).all(axis=1).mean()) if known.any() else None


def _sigma_ratio(error_m: Float, sigma_m: Float) -> float | None:
    known = np.isfinite(error_m).all(axis=1) & np.isfinite(sigma_m).all(axis=1)
    rms_m = float(np.sqrt(np.mean((error_m[known] ** 2).sum(axis=1)))) if known.any() else 0.0
    return float(np.median(np.linalg.norm(sigma_m[known], axis=1))) / rms_m if rms_m > 0.0 else None


def errors(found: Compared) -> ErrorsOut | None:
    """Return the errors of the rows given, or None when nothing could be compared."""
    rotation, position, velocity, sigma = found.rotation_n_rad, found.position_m, found.velocity_n_m_s, found.sigma
    usable = np.asarray(np.isfinite(np.hstack([rotation, position, velocity])).any(axis=1))
    if not usable.any():
        return None
    up_m = position[:, 2]
    median_m = float(np.median(up_m[np.isfinite(up_m)])) if np.isfinite(up_m).any() else None
    return ErrorsOut(
        t_from_ns=int(found.t_ns[usable][0]),
        t_to_ns=int(found.t_ns[usable][-1]),
        rows=int(usable.sum()),
        attitude_rad=spread(np.linalg.norm(rotation, axis=1)),
        heading_rad=spread(rotation[:, 2]),
        tilt_rad=spread(np.hypot(rotation[:, 0], rotation[:, 1])),
        horizontal_m=spread(np.hypot(position[:, 0], position[:, 1])),
        vertical_m=spread(up_m),
        vertical_median_m=median_m,
        vertical_less_median_m=None if median_m is None else spread(up_m - median_m),
        vel_n_m_s=spread(velocity[:, 0]),
        vel_e_m_s=spread(velocity[:, 1]),
        vel_d_m_s=spread(velocity[:, 2]),
        cover_3sigma=CoverOut(
            horizontal=_cover(position[:, :2], sigma[:, 6:8]),
            vertical=_cover(position[:, 2:], sigma[:, 8:9]),
            velocity=_cover(velocity, sigma[:, 3:6]),
            attitude=_cover(rotation, sigma[:, 0:3]),
        ),
        sigma_ratio_horizontal=_sigma_ratio(position[:, :2], sigma[:, 6:8]),
    )


def outage(found: Compared, t_origin_ns: int, stretch_s: Sequence[float]) -> OutageOut:
    """Return what became of one withheld stretch [a, b) in seconds after the origin."""
    start_ns, stop_ns = (t_origin_ns + round(edge_s * 1e9) for edge_s in stretch_s)
    part = found.within(start_ns, stop_ns)
    known = np.isfinite(part.position_m[:, :2]).all(axis=1)
    ne_m, sigma_m = part.position_m[known, :2], part.sigma[known, 6:8]
    horizontal_m = np.linalg.norm(ne_m, axis=1)
    sigmas = np.abs(ne_m) / sigma_m
    angle_rad = np.linalg.norm(part.rotation_n_rad, axis=1)
    angle_rad = angle_rad[np.isfinite(angle_rad)]
    return OutageOut(
        from_s=stretch_s[0],
        to_s=stretch_s[1],
        rows=int(known.sum()),
        peak_horizontal_m=float(horizontal_m.max()) if len(horizontal_m) else None,
        peak_horizontal_sigmas=float(np.nanmax(sigmas)) if np.isfinite(sigmas).any() else None,
        end_horizontal_m=float(horizontal_m[-1]) if len(horizontal_m) else None,
        end_attitude_rad=float(angle_rad[-1]) if len(angle_rad) else None,
    )
