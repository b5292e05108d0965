"""Quaternion complementary filter: gyro, gravity, magnetometer; velocity and position are the receiver's [S0 ch. 4].

S0's first algorithm; its stored text stops before the equations, so this is the usual form [Mahony, Hamel, Pflimlin
2008, explicit complementary filter with bias]: the attitude follows the rate and turns towards what gravity and the
field show with time constants; gravity corrects tilt only, the field heading only. After the start the weights are
larger until they have settled (`attitude.weights`). There is no dead reckoning: without GNSS the last velocity carries
the position on for two seconds, then both are held, and the status and the age say so.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

from server.nav.codes import ALIGNING, DEAD_RECKONING, FUSED, GNSS, NAVIGATING
from server.nav.earth import curvature_radii, ned_from_lla
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_T, U_DT, U_GAP_S, U_T
from server.nav.kernel import kernel
from server.nav.lanes.attitude import (
    FIELD_GAP_S,
    GAP_RESTART_S,
    LEAST_NORTH_GAUSS,
    MAGNETIC,
    NO_HEADING,
    PAR_GNSS,
    PAR_IMU,
    PAR_OWN,
    S_AGE,
    S_BIAS,
    S_HEADING,
    S_OWN,
    S_SINCE_FIELD,
    S_STARTED,
    blank,
    fail,
    feed_bias,
    finite,
    heading_error,
    integrate,
    publish,
    start,
    take_field,
    tilt_error,
    turn_n,
    usable,
    weights,
)
from server.nav.lanes.base import LaneContext, Parameter, Provides
from server.nav.lanes.kernel_lane import ARRAYS, KernelLane
from server.nav.types import Float, Site

S_POSITIONED: Final = S_OWN
S_T_GNSS: Final = S_OWN + 1  # time of validity on the row's clock, ns
S_LLA: Final = S_OWN + 2  # (3) rad, rad, m
S_VEL: Final = S_OWN + 5  # (3) NED, m/s; NaN unknown
S_SITE: Final = S_OWN + 8  # has one, then latitude rad, longitude rad, height m
SIZE: Final = S_OWN + 12
PAR_TILT: Final = PAR_OWN  # s
PAR_FIELD: Final = PAR_OWN + 1  # s
PAR_BIAS: Final = PAR_OWN + 2  # s
OUTAGE_S: Final = 2.0


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _to_gravity(u: Float, par: Float, s: Float) -> None:
    """Turn the tilt towards the accelerometer's vertical."""
    ex, ey = tilt_error(u, s)
    k, kb = weights(1.0 / par[PAR_TILT], 1.0 / (par[PAR_TILT] * par[PAR_BIAS]), u[U_DT], s[S_AGE])
    turn_n(s, k * ex, k * ey, 0.0)
    feed_bias(s, kb, ex, ey, 0.0)


@kernel("void(float64[::1], float64[::1])")
def _to_field(par: Float, s: Float) -> None:
    """Turn the heading towards the field's; at once when it is the first."""
    angle, north = heading_error(s)
    if north <= LEAST_NORTH_GAUSS:
        return
    if s[S_HEADING] == NO_HEADING:
        turn_n(s, 0.0, 0.0, angle)
        s[S_HEADING] = MAGNETIC
    else:
        since_s = min(FIELD_GAP_S, s[S_SINCE_FIELD])
        k, kb = weights(1.0 / par[PAR_FIELD], 1.0 / (par[PAR_FIELD] * par[PAR_BIAS]), since_s, s[S_AGE])
        turn_n(s, 0.0, 0.0, k * angle)
        feed_bias(s, kb, 0.0, 0.0, angle)
    s[S_SINCE_FIELD] = 0.0


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _take_gnss(m: Float, par: Float, s: Float) -> None:
    """Keep a fix: position and velocity, whichever it has."""
    if math.isfinite(m[M_DATA]) and math.isfinite(m[M_DATA + 1]):
        s[S_LLA], s[S_LLA + 1], s[S_LLA + 2] = math.radians(m[M_DATA]), math.radians(m[M_DATA + 1]), m[M_DATA + 2]
        s[S_T_GNSS], s[S_POSITIONED] = m[M_T] - par[PAR_GNSS] * 1e9, 1.0
    for i in range(3):
        s[S_VEL + i] = m[M_DATA + 3 + i]


@kernel("void(float64, float64[::1], float64[::1])")
def _publish_position(t_ns: float, s: Float, out: Float) -> None:
    """Write the receiver's velocity and position, carried on by that velocity from its time of validity to t."""
    age_s = max(0.0, (t_ns - s[S_T_GNSS]) * 1e-9)
    carried_s = min(OUTAGE_S, age_s)
    step = (0.0, 0.0, 0.0)
    if math.isfinite(s[S_VEL]) and math.isfinite(s[S_VEL + 1]):
        down = s[S_VEL + 2] if math.isfinite(s[S_VEL + 2]) else 0.0
        step = (s[S_VEL] * carried_s, s[S_VEL + 1] * carried_s, down * carried_s)
    meridian, prime = curvature_radii(s[S_LLA])
    height = s[S_LLA + 2] if math.isfinite(s[S_LLA + 2]) else 0.0
    lat = s[S_LLA] + step[0] / (meridian + height)
    lon = s[S_LLA + 1] + step[1] / ((prime + height) * max(1e-6, math.cos(s[S_LLA])))
    for i in range(3):
        out[4 + i] = s[S_VEL + i]
    out[7], out[8] = math.degrees(lat), (math.degrees(lon) + 180.0) % 360.0 - 180.0
    out[9] = s[S_LLA + 2] - step[2]
    if s[S_SITE] != 0.0:
        out[26], out[27], out[28] = ned_from_lla(lat, lon, out[9], s[S_SITE + 1], s[S_SITE + 2], s[S_SITE + 3])
    out[25] = DEAD_RECKONING if age_s > OUTAGE_S else NAVIGATING
    out[29] = age_s if age_s > OUTAGE_S else 0.0


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _advance(u: Float, par: Float, s: Float) -> None:
    integrate(u, s)
    s[S_AGE] += u[U_DT]
    s[S_SINCE_FIELD] += u[U_DT]
    _to_gravity(u, par, s)


@kernel("void(float64[::1], float64[::1])")
def _forget(s: Float, out: Float) -> None:
    """Start again, the site kept, and say so."""
    site = (s[S_SITE], s[S_SITE + 1], s[S_SITE + 2], s[S_SITE + 3])
    fail(s, out)
    for i in range(4):
        s[S_SITE + i] = site[i]
    for i in range(3):
        s[S_VEL + i] = math.nan


@kernel(ARRAYS)
def run(steps: Float, meas: Float, par: Float, s: Float, rows: Float) -> None:
    """Run over navigation steps; see `KernelLane`. A gyro bias learned before a hole is kept."""
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        if not usable(u):
            _forget(s, rows[n])
            continue
        blank(rows[n], ALIGNING)
        if u[U_GAP_S] > GAP_RESTART_S:
            s[S_STARTED] = 0.0
        elif s[S_STARTED] == 0.0:
            start(u, s)
        else:
            _advance(u, par, s)
        first = k
        k, count = take_field(meas, k, n, u, par, s)
        for i in range(first, k):
            if int(meas[i, M_KIND]) == GNSS and int(meas[i, M_STATUS]) == FUSED:
                _take_gnss(meas[i], par, s)
        if s[S_STARTED] == 0.0:
            continue
        if count:
            _to_field(par, s)
        if not finite(s, S_OWN):
            _forget(s, rows[n])
            continue
        publish(u, s, par[PAR_IMU], rows[n])
        for i in range(3):
            rows[n, 19 + i] = s[S_BIAS + i]
        if s[S_POSITIONED] != 0.0:
            _publish_position(u[U_T], s, rows[n])


class Complementary(KernelLane):
    """The thesis's plain filter: what a user gets without an EKF."""

    name: ClassVar[str] = "complementary"
    provides: ClassVar[Provides] = "full"
    size: ClassVar[int] = SIZE
    kernel = staticmethod(run)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="tilt_time_constant_s", unit="s", default=10.0, minimum=0.05, maximum=1000.0,
            meaning="Time in which gravity corrects the tilt; larger takes less acceleration for tilt.",
        ),
        Parameter(
            name="heading_time_constant_s", unit="s", default=15.0, minimum=0.05, maximum=1000.0,
            meaning="Time in which the magnetic field corrects the heading; larger ignores short disturbances.",
        ),
        Parameter(
            name="bias_time_constant_s", unit="s", default=300.0, minimum=1.0, maximum=100000.0,
            meaning="Time in which a lasting error becomes gyro bias; below four times the others it rings.",
        ),
    )  # fmt: skip

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        super().__init__(context)
        self._s[S_VEL : S_VEL + 3] = math.nan

    def set_site(self, site: Site) -> None:
        """Take the origin and the declination; a heading held against magnetic north turns by it at once."""
        super().set_site(site)
        self._s[S_SITE : S_SITE + 4] = 1.0, math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m
