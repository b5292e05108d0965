"""Gravity and geometry against published constants and against ECEF, a second way round."""

import math

import numpy as np
import pytest

from server.nav.earth import curvature_radii, ned_from_lla, normal_gravity


def test_gravity_at_equator_and_pole_is_the_published_one():
    assert normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity(math.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-9)


def test_gravity_falls_by_the_free_air_gradient():
    """3.086 µm/s² per metre at mid latitudes (free-air gradient)."""
    drop = normal_gravity(math.radians(45), 0.0) - normal_gravity(math.radians(45), 1000.0)
    assert drop == pytest.approx(3.086e-3, rel=2e-3)


def test_radii_at_equator_and_pole():
    a, f = 6378137.0, 1 / 298.257223563
    b = a * (1 - f)
    assert curvature_radii(0.0) == pytest.approx((b * b / a, a), rel=1e-12)
    assert curvature_radii(math.pi / 2) == pytest.approx((a * a / b, a * a / b), rel=1e-12)


def ecef(lat, lon, h):
    a, e2 = 6378137.0, 6.69437999014e-3
    n = a / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    return np.array(
        [
            (n + h) * math.cos(lat) * math.cos(lon),
            (n + h) * math.cos(lat) * math.sin(lon),
            (n * (1 - e2) + h) * math.sin(lat),
        ]
    )


@pytest.mark.parametrize("lat_deg", [-60.0, 0.0, 47.4])
def test_short_distances_are_those_of_ecef(lat_deg):
    lat0, lon0, h0 = math.radians(lat_deg), math.radians(8.5), 500.0
    lat, lon, h = lat0 + 8e-6, lon0 + 9e-6, 520.0
    s, c, sl, cl = math.sin(lat0), math.cos(lat0), math.sin(lon0), math.cos(lon0)
    R_ne = np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])
    expected = R_ne @ (ecef(lat, lon, h) - ecef(lat0, lon0, h0))
    np.testing.assert_allclose(ned_from_lla(lat, lon, h, lat0, lon0, h0), expected, atol=2e-3)


def test_the_date_line_is_not_a_step():
    east = ned_from_lla(0.0, -math.pi + 1e-7, 0.0, 0.0, math.pi - 1e-7, 0.0)[1]
    assert east == pytest.approx(2e-7 * 6378137.0, rel=1e-6)
