"""Where the demo board flies: a polyline of place and heading over time, made smooth by a B-spline, for ever again.

The control points of a uniform quintic B-spline are samples of the polyline at a fixed spacing. The spline is then
C⁴, each piece depends on six control points only, and where those are equal it stands exactly still.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float

SPACING_S: Final = 0.8
"""Distance of the control points; a corner of the polyline is rounded over about three of them."""
DEGREE: Final = 5
REACH_S: Final = 0.5 * (DEGREE + 1) * SPACING_S
"""The spline sees the polyline this far before and after."""

STAND_S: Final = 12.0
"""Standing still after power-up, for the alignment and the gyro bias."""
REST_S: Final = 8.0
"""Standing still after the landing; then the flight begins again."""
HEIGHT_M: Final = 20.0
SIDE_M: Final = 40.0
SPEED_M_S: Final = 5.5
EIGHT_M: Final = 27.0
"""Half length of the figure eight."""
YAW_START_RAD: Final = math.radians(20.0)


class _Route:
    """Nominal polyline under construction: rows of (t, north, east, height, yaw)."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, float, float, float, float]] = [(0.0, 0.0, 0.0, 0.0, YAW_START_RAD)]

    def go(self, duration_s: float, north_m: float, east_m: float, height_m: float) -> None:
        """Append a straight line at constant heading."""
        t, *_, yaw = self.rows[-1]
        self.rows.append((t + duration_s, north_m, east_m, height_m, yaw))

    def stay(self, duration_s: float) -> None:
        """Append a stop."""
        t, *place = self.rows[-1]
        self.rows.append((t + duration_s, *place))  # type: ignore[arg-type]  # the four others of a row

    def turn(self, duration_s: float, yaw_rad: float) -> None:
        """Append a turn on the spot to an unwrapped heading."""
        t, north, east, height, _ = self.rows[-1]
        self.rows.append((t + duration_s, north, east, height, yaw_rad))

    def eight(self, duration_s: float) -> None:
        """Append a lemniscate that starts and ends northward in the middle, nose along the course."""
        t0, north0, east0, height0, yaw0 = self.rows[-1]
        theta = np.linspace(0.5 * math.pi, 2.5 * math.pi, 241)
        x = EIGHT_M * np.cos(theta) / (1.0 + np.sin(theta) ** 2)
        y = x * np.sin(theta)
        forward, right = -(x + y) * math.sqrt(0.5), (y - x) * math.sqrt(0.5)  # the branch leaves to the north
        course = np.unwrap(np.arctan2(np.gradient(right), np.gradient(forward)))
        course += yaw0 - course[0]
        height = height0 + 3.0 * np.sin(theta - 0.5 * math.pi)
        times = t0 + duration_s * np.linspace(0.0, 1.0, theta.size)
        table = np.column_stack([times, north0 + forward, east0 + right, height, course])
        self.rows += [tuple(row) for row in table[1:].tolist()]


def _mission() -> Float:
    """Return the polyline: take-off, square with turns, figure eight, landing."""
    route = _Route()
    route.stay(STAND_S + REACH_S)
    route.go(11.0, 0.0, 0.0, HEIGHT_M)
    corners = ((SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M), (0.0, 0.0))
    for leg, (north_m, east_m) in enumerate(corners):
        route.turn(2.5, leg * 0.5 * math.pi)
        route.stay(1.5)
        route.go(SIDE_M / SPEED_M_S, north_m, east_m, HEIGHT_M)
        route.stay(1.0)
    route.turn(2.5, 2.0 * math.pi)
    route.stay(1.5)
    route.eight(27.0)
    route.stay(2.5)
    route.turn(2.0, 2.0 * math.pi + YAW_START_RAD)
    route.go(9.0, 0.0, 0.0, 4.0)
    route.go(6.0, 0.0, 0.0, 0.0)
    route.stay(REACH_S + REST_S)
    end_s = route.rows[-1][0]
    route.stay(math.ceil(end_s) - end_s)
    return np.array(route.rows)


def _control_points(route: Float) -> Float:
    """Return the spline's control points, shape (n, 4): north, east, down, unwrapped yaw."""
    n = math.ceil(route[-1, 0] / SPACING_S) + DEGREE + 2
    at_s = (np.arange(n) - 0.5 * (DEGREE - 1)) * SPACING_S  # Greville points: the spline follows the polyline in time
    points = np.column_stack([np.interp(at_s, route[:, 0], route[:, i]) for i in range(1, 5)])
    points[:, 2] *= -1.0
    return points


_ROUTE: Final = _mission()
PERIOD_S: Final = int(_ROUTE[-1, 0])
"""Length of one flight, whole seconds: at its end the board stands as it stood at power-up, one turn further."""
_POINTS: Final = _control_points(_ROUTE)
_BASIS: Final = (
    np.array(
        [
            [1, 26, 66, 26, 1, 0],
            [-5, -50, 0, 50, 5, 0],
            [10, 20, -60, 20, 10, 0],
            [-10, 20, 0, -20, 10, 0],
            [5, -20, 30, -20, 5, 0],
            [-1, 5, -10, 10, -5, 1],
        ]
    )
    / 120.0
)
"""Uniform quintic B-spline: row = power of the place between two knots, column = control point."""
_POWERS: Final = np.arange(DEGREE + 1)


def path_at(t_s: Float) -> tuple[Float, Float, Float]:
    """Return position, velocity and acceleration with yaw as the fourth column (m, m/s, m/s² NED; rad unwrapped).

    Args:
        t_s: shape (n,), seconds since power-up.
    """
    place = np.mod(t_s, PERIOD_S) / SPACING_S
    first = place.astype(np.int64)
    power = (place - first)[:, None] ** _POWERS
    near = _POINTS[first[:, None] + _POWERS]
    slope = np.zeros_like(power)
    slope[:, 1:] = power[:, :-1] * _POWERS[1:]
    bend = np.zeros_like(power)
    bend[:, 2:] = power[:, :-2] * (_POWERS[2:] * _POWERS[1:-1])
    rows = (power, slope / SPACING_S, bend / SPACING_S**2)
    return tuple(np.vecmat(row @ _BASIS, near) for row in rows)
