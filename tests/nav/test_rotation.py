"""Rotations against SciPy's, an implementation of its own."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.rotation import (
    euler_from_quat,
    matrix_from_quat,
    quat_from_euler,
    quat_from_rotvec,
    quat_mul,
    rotvec_from_quat,
)

RNG = np.random.default_rng(7)


@pytest.mark.parametrize("size_rad", [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 3.1])
def test_rotation_vector_becomes_scipys_quaternion(size_rad):
    axis = RNG.standard_normal(3)
    vector = axis / np.linalg.norm(axis) * size_rad
    x, y, z, w = Rotation.from_rotvec(vector).as_quat()
    np.testing.assert_allclose(quat_from_rotvec(*vector), [w, x, y, z], atol=1e-15)


def test_logarithm_undoes_the_exponential():
    for _ in range(50):
        vector = RNG.uniform(-1.7, 1.7, 3)
        np.testing.assert_allclose(rotvec_from_quat(*quat_from_rotvec(*vector)), vector, atol=1e-12)


def test_product_and_matrix_agree_with_scipy():
    for _ in range(20):
        a, b = (
            Rotation.random(random_state=int(RNG.integers(1e6))),
            Rotation.random(random_state=int(RNG.integers(1e6))),
        )
        qa, qb = a.as_quat()[[3, 0, 1, 2]], b.as_quat()[[3, 0, 1, 2]]
        product = np.array(quat_mul(*qa, *qb))
        np.testing.assert_allclose(matrix_from_quat(product), (a * b).as_matrix(), atol=1e-14)


def test_euler_angles_are_aerospace_order_and_come_back():
    for roll, pitch, yaw in ((0.1, -0.2, 3.0), (-3.0, 1.4, 6.2), (0.0, 0.0, 0.0)):
        q_nb = quat_from_euler(roll, pitch, yaw)
        expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
        np.testing.assert_allclose(matrix_from_quat(q_nb), expected, atol=1e-14)
        np.testing.assert_allclose(euler_from_quat(q_nb), (roll, pitch, yaw), atol=1e-12)


def test_yaw_is_clockwise_from_north():
    forward_n = matrix_from_quat(quat_from_euler(0.0, 0.0, np.pi / 2))[:, 0]
    np.testing.assert_allclose(forward_n, [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("bad", [[1.0, 0.1, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
def test_what_is_no_unit_quaternion_is_refused(bad):
    with pytest.raises(ValueError, match="unit norm"):
        matrix_from_quat(np.array(bad))
