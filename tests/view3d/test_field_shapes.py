"""What is drawn of a magnetometer is the same whatever the unit, and lies where the law of the ellipsoid puts it."""

import numpy as np
import pytest

from server.nav.types import Float
from server.view3d.field_shapes import (
    MAX_POINTS,
    Surface,
    extent_of,
    globe_lines,
    rings_about,
    surface_from,
    thinned,
)

OFFSET = np.array([120.0, -340.0, 55.0])
SOFT = np.array([[1.2, 0.1, 0.0], [0.1, 0.9, -0.05], [0.0, -0.05, 1.0]])
FIELD = 480.0


def directions(count: int) -> Float:
    v = np.random.default_rng(7).normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def measured(count: int = 400) -> Float:
    """Raw values of a sensor that distorts a field of constant strength: raw = offset + SOFT⁻¹ · field."""
    return np.asarray(OFFSET + FIELD * np.linalg.solve(SOFT, directions(count).T).T)


def surface() -> Surface:
    found = surface_from(tuple(OFFSET), SOFT, measured())
    assert found is not None
    return found


def test_the_surface_goes_through_noiseless_points() -> None:
    assert surface().radius == pytest.approx(FIELD)
    np.testing.assert_allclose(surface().at(directions(400)), measured(), rtol=1e-9)
    assert surface().misfit(measured()).max() < 1e-9


def test_calibrated_points_lie_on_the_unit_sphere() -> None:
    np.testing.assert_allclose(surface().calibrated(measured()), directions(400), atol=1e-9)


def test_the_misfit_is_the_share_of_the_field_by_which_a_point_is_off() -> None:
    off = OFFSET + 1.03 * (measured() - OFFSET)
    np.testing.assert_allclose(surface().misfit(off), 0.03, atol=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-3, 37.0])
def test_the_drawing_is_the_same_in_any_unit(unit: float) -> None:
    points = unit * measured()
    found = surface_from(unit * OFFSET, SOFT, points)
    drawn = extent_of(found, points).drawn(points)
    np.testing.assert_allclose(drawn, extent_of(surface(), measured()).drawn(measured()), atol=1e-9)
    assert 0.9 < np.linalg.norm(drawn, axis=1).max() <= 1.0 + 1e-9


def test_before_a_fit_points_lie_about_the_sensors_zero() -> None:
    extent = extent_of(None, measured())
    assert not extent.centre.any()
    assert np.linalg.norm(extent.drawn(measured()), axis=1).max() == pytest.approx(1.0)
    assert extent_of(None, np.empty((0, 3))).size == 1.0


def test_small_changes_of_a_fit_do_not_move_the_drawing() -> None:
    points = measured()
    extent = extent_of(surface(), points)
    assert extent.near(extent_of(surface_from(OFFSET + 0.005 * FIELD, SOFT, points), points))
    assert not extent.near(extent_of(surface_from(OFFSET + 0.1 * FIELD, SOFT, points), points))
    assert not extent.near(extent_of(surface_from(OFFSET, 0.8 * SOFT @ np.diag([1, 1, 0.7]), points), points))


@pytest.mark.parametrize(
    ("offset", "matrix"),
    [((), ()), ((0, 0, 0), ()), ((0, 0, float("nan")), np.eye(3)), ((0, 0, 0), np.diag([1.0, 1.0, 0.0]))],
)
def test_what_cannot_be_drawn_is_no_surface(offset: tuple[float, ...], matrix: Float) -> None:
    assert surface_from(offset, matrix, measured()) is None


def test_points_are_thinned_evenly_and_the_broken_ones_left_out() -> None:
    many = np.arange(3 * 9000, dtype=np.float64).reshape(-1, 3)
    many[5] = np.nan
    few = thinned(many)
    assert len(few) == MAX_POINTS
    assert np.isfinite(few).all()
    assert few[0, 0] == 0.0
    assert few[-1, 0] == many[-1, 0]
    assert np.ptp(np.diff(few[:, 0])) <= 6.0
    assert thinned(np.empty((0, 3))).shape == (0, 3)


def test_the_globes_lines_lie_on_the_unit_sphere_in_short_pieces() -> None:
    starts, ends = globe_lines()
    np.testing.assert_allclose(np.linalg.norm(starts, axis=1), 1.0)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 1.0)
    assert np.linalg.norm(ends - starts, axis=1).max() < 0.2
    assert len(starts) < 500


def test_rings_lie_flat_on_their_direction() -> None:
    out = np.vstack([directions(30), np.eye(3), -np.eye(3)])
    ring = rings_about(2.0 * out, out, 0.1, 0.03)
    vertices = ring.vertices.reshape(len(out), -1, 3) - 2.0 * out[:, None]
    assert np.abs(np.einsum("nvk,nk->nv", vertices, out)).max() < 1e-12
    sizes = np.linalg.norm(vertices, axis=2)
    np.testing.assert_allclose(np.unique(sizes.round(9)), [0.07, 0.1])
    corners = ring.vertices[ring.faces]
    assert np.linalg.norm(np.diff(corners, axis=1), axis=2).max() < 0.11  # no triangle joins two rings
