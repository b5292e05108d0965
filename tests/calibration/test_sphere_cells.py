"""The cells of the sphere are of nearly equal area, and every direction has one."""

import numpy as np

from server.nav.calibration.sphere_cells import CELLS, DIRECTIONS, cell_of
from tests.calibration.ellipsoid_truth import uniform


def test_cells_have_nearly_equal_areas():
    cells = cell_of(uniform(np.random.default_rng(0), 200_000))
    share = np.bincount(cells, minlength=CELLS) / 200_000 * CELLS
    assert 0.8 < share.min() < share.max() < 1.2


def test_each_centre_is_a_unit_direction_in_its_own_cell_whatever_its_length():
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1.0)
    np.testing.assert_array_equal(cell_of(DIRECTIONS * 7.0), np.arange(CELLS))
