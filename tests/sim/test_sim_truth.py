"""The truth obeys mechanics, whatever the path: each law is checked by a second method."""

import math

import numpy as np
import pytest

from server.nav.types import Float
from server.sim import SimSettings, earth
from server.sim.path import PERIOD_S, REST_S, STAND_S, path_at
from server.sim.truth import DRAG_PER_S, FlightTruth, TruthState, imu_between

EARTH_RATE_RAD_S = 7.292115e-5
SEMI_MAJOR_M = 6378137.0
E2 = 0.00669437999014


@pytest.fixture(scope="module")
def flight() -> TruthState:
    """One whole flight and the first seconds of the next, at 1 kHz, in wind."""
    return FlightTruth(SimSettings(wind_m_s=6.0)).at(np.arange(0.0, (PERIOD_S + 5) * 1000.0) * 1e-3)


def turned_by(q_a: Float, q_b: Float) -> Float:
    return np.asarray(2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(q_a * q_b, axis=-1)))))


def test_the_flight_repeats_for_ever_without_a_jump() -> None:
    truth = FlightTruth(SimSettings())
    for flights in (1, 2, 50):
        seam_s = PERIOD_S * flights + np.array([-1e-3, 0.0, 1e-3])
        state = truth.at(seam_s)
        assert np.abs(np.diff(state.pos_n_m, axis=0)).max() < 1e-12
        assert np.abs(np.diff(state.vel_n_m_s, axis=0)).max() < 1e-12
        assert turned_by(state.q_nb[1:], state.q_nb[:-1]).max() < 1e-7
        assert np.abs(np.diff(state.accel_b_m_s2, axis=0)).max() < 1e-9
    middle_s = np.array([40.0, 90.0])
    again = truth.at(middle_s + PERIOD_S)
    np.testing.assert_allclose(again.vel_n_m_s, truth.at(middle_s).vel_n_m_s, atol=1e-9)
    np.testing.assert_allclose(again.accel_b_m_s2, truth.at(middle_s).accel_b_m_s2, atol=1e-9)


def test_velocity_and_acceleration_are_the_slopes_of_the_path() -> None:
    t_s, h = np.linspace(0.01, PERIOD_S - 0.01, 5000), 1e-4
    _, vel, acc = path_at(t_s)
    ahead, behind = path_at(t_s + h), path_at(t_s - h)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), vel, atol=1e-6)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), acc, atol=1e-6)


def steps(state: TruthState, stride: int) -> tuple[float, float, float]:
    """Largest step of jerk, body rate and specific force between neighbours `stride` ms apart."""
    dt_s = stride * 1e-3
    jerk = np.diff(path_at(state.t_s[::stride])[2], axis=0) / dt_s
    q = state.q_nb[::stride]
    q = q * np.where(np.sum(q * np.roll(q, 1, axis=0), axis=1) < 0.0, -1.0, 1.0).cumprod()[:, None]
    rate = np.linalg.norm(np.diff(q, axis=0), axis=1) / dt_s
    return (
        float(np.abs(np.diff(jerk, axis=0)).max()),
        float(np.abs(np.diff(rate)).max()),
        float(np.abs(np.diff(state.accel_b_m_s2[::stride], axis=0)).max()),
    )


def test_jerk_rates_and_force_have_no_step(flight: TruthState) -> None:
    """Between closer neighbours a continuous function changes less in proportion; a step would stay."""
    fine, coarse = steps(flight, 2), steps(flight, 8)
    for a, b in zip(fine, coarse, strict=True):
        assert a < 0.3 * b


def test_at_rest_the_specific_force_is_minus_gravity(flight: TruthState) -> None:
    still = flight.t_s < STAND_S
    assert np.abs(flight.pos_n_m[still]).max() < 1e-12
    sin2 = math.sin(math.radians(47.3977)) ** 2
    normal = 9.7803253359 * (1 + 0.00193185265241 * sin2) / math.sqrt(1 - E2 * sin2)
    g_m_s2 = normal - 3.086e-6 * (488.0 + 47.3)  # free-air gradient: a second formula for the height
    np.testing.assert_allclose(np.linalg.norm(flight.accel_b_m_s2[still], axis=1), g_m_s2, atol=2e-5)
    up_n = np.matvec(flight.R_nb[still], flight.accel_b_m_s2[still])
    np.testing.assert_allclose(up_n, np.tile([0.0, 0.0, -g_m_s2], (still.sum(), 1)), atol=2e-5)


def test_it_stands_before_and_after_and_flies_as_told_between(flight: TruthState) -> None:
    speed = np.linalg.norm(flight.vel_n_m_s, axis=1)
    t_s = flight.t_s
    assert speed[(t_s < STAND_S) | ((t_s > PERIOD_S - REST_S) & (t_s < PERIOD_S))].max() < 1e-12
    cruise = (t_s > 28.0) & (t_s < 75.0)
    assert 5.0 < np.percentile(speed[cruise], 90) < 6.0
    np.testing.assert_allclose(-flight.pos_n_m[cruise, 2], 20.0, atol=0.5)
    assert np.degrees(np.arccos(flight.R_nb[:, 2, 2].min())) > 20.0, "the figure eight is flown with bank"


def test_the_rotors_push_along_body_z_only_and_the_rest_is_drag(flight: TruthState) -> None:
    air = -flight.pos_n_m[:, 2] > 12.0
    drag_n = -DRAG_PER_S * (flight.vel_n_m_s[air] - flight.wind_n_m_s[air])
    push_b = flight.accel_b_m_s2[air] - np.vecmat(drag_n, flight.R_nb[air])
    assert np.abs(push_b[:, :2]).max() < 2e-3  # Coriolis acceleration
    assert push_b[:, 2].max() < -5.0


def test_hovering_it_leans_against_the_wind(flight: TruthState) -> None:
    hover = (np.linalg.norm(flight.vel_n_m_s, axis=1) < 0.05) & (-flight.pos_n_m[:, 2] > 15.0)
    assert hover.sum() > 1000
    lean = np.sum(-flight.R_nb[hover, :2, 2] * flight.wind_n_m_s[hover, :2], axis=1)
    assert lean.max() < 0.0


def test_the_two_forms_of_the_attitude_agree_and_turn_rightly(flight: TruthState) -> None:
    w, x, y, z = flight.q_nb.T
    np.testing.assert_allclose(np.linalg.norm(flight.q_nb, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(flight.R_nb[:, 0, 0], 1 - 2 * (y * y + z * z), atol=1e-12)
    np.testing.assert_allclose(flight.R_nb[:, 2, 1], 2 * (y * z + w * x), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(flight.R_nb[::100]), 1.0, atol=1e-12)


def times(a: Float, b: Float) -> Float:
    """Hamilton product of rows."""
    w = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    return np.concatenate([w, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])], axis=1)


def exp_rows(angle: Float) -> Float:
    norm = np.linalg.norm(angle, axis=1, keepdims=True)
    return np.concatenate([np.cos(norm / 2), 0.5 * angle * np.sinc(norm / (2 * math.pi))], axis=1)


def running_product(q: Float) -> Float:
    """Products q0, q0⊗q1, … by doubling."""
    reach, q = 1, q.copy()
    while reach < len(q):
        q[reach:] = times(q[:-reach], q[reach:])
        reach *= 2
    return q


def matrices(q: Float) -> Float:
    eye = np.eye(3)
    columns = [times(times(q, np.tile([0.0, *e], (len(q), 1))), q * [1, -1, -1, -1])[:, 1:] for e in eye]
    return np.stack(columns, axis=2)


def inertial(t_s: Float, geodetic: Float, vel_n: Float) -> tuple[Float, Float, Float]:
    """Position, velocity and the NED axes (columns) in the inertial frame that meets ECEF at t = 0."""
    lat, lon, height = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1]), geodetic[:, 2] + earth.GEOID_M
    theta = lon + EARTH_RATE_RAD_S * t_s
    radius = SEMI_MAJOR_M / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    equator = (radius + height) * np.cos(lat)
    place = np.stack([equator * np.cos(theta), equator * np.sin(theta), (radius * (1 - E2) + height) * np.sin(lat)], 1)
    north = np.stack([-np.sin(lat) * np.cos(theta), -np.sin(lat) * np.sin(theta), np.cos(lat)], 1)
    east = np.stack([-np.sin(theta), np.cos(theta), np.zeros_like(theta)], 1)
    axes = np.stack([north, east, np.cross(north, east)], axis=2)
    spin = EARTH_RATE_RAD_S * np.stack([-place[:, 1], place[:, 0], np.zeros_like(theta)], 1)
    return place, np.matvec(axes, vel_n) + spin, axes


def test_an_inertial_integrator_fed_with_the_ideal_imu_stays_on_the_path(flight: TruthState) -> None:
    """Another formulation (Earth-centred inertial, no transport rate, no Coriolis) for 120 s from rest."""
    first, n, dt_s = 5000, 120_000, 1e-3
    rate_b, force_b = (x[first : first + n] for x in imu_between(flight))
    rows = slice(first, first + n + 1)
    geodetic = earth.geodetic_from_ned(flight.pos_n_m[rows])
    place_i, vel_i, axes = inertial(flight.t_s[rows], geodetic, flight.vel_n_m_s[rows])
    R_ib_true = axes @ flight.R_nb[rows]
    q = running_product(exp_rows(rate_b * dt_s))
    R_ib = R_ib_true[0] @ np.concatenate([np.eye(3)[None], matrices(q)])
    tilt = np.arccos(np.clip((np.trace(np.swapaxes(R_ib, 1, 2) @ R_ib_true, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert tilt.max() < 3e-6

    force_i = 0.5 * (np.matvec(R_ib[1:], force_b) + np.matvec(R_ib[:-1], force_b))
    down, height = axes[:, :, 2], geodetic[:, 2] + earth.GEOID_M
    sin2 = np.sin(np.radians(geodetic[:, 0])) ** 2
    normal = 9.7803253359 * (1 + 0.00193185265241 * sin2) / np.sqrt(1 - E2 * sin2) - 3.0855e-6 * height
    pull = normal[:, None] * down - EARTH_RATE_RAD_S**2 * place_i * [1.0, 1.0, 0.0]  # gravity → gravitation
    accel_i = force_i + 0.5 * (pull[1:] + pull[:-1])
    vel = vel_i[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(accel_i * dt_s, axis=0)])
    place = place_i[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (vel[1:] + vel[:-1]) * dt_s, axis=0)])
    assert np.abs(vel - vel_i).max() < 1e-4
    apart_m = np.linalg.norm(place - place_i, axis=1)
    assert apart_m[60_000] < 2e-3
    assert apart_m.max() < 5e-3
