"""The streaming accumulator: exact moments, however cut, ordered, far away or long; constant memory."""

import numpy as np
import pytest

from server.nav.calibration.ellipsoid_kernel import CUBES
from server.nav.calibration.ellipsoid_moments import EXPONENTS, MomentStream
from tests.calibration.ellipsoid_truth import hand_sweep, uniform


def by_definition(xyz, centre, radius):
    """Sums of all monomials up to order 4: the plain twin of the kernel."""
    u = (xyz - centre) / radius
    return np.array([np.sum(u[:, 0] ** i * u[:, 1] ** j * u[:, 2] ** k) for i, j, k in EXPONENTS])


def streamed(xyz, cuts=()):
    stream = MomentStream()
    for part in np.split(xyz, list(cuts)):
        stream.feed(part)
    return stream


@pytest.mark.parametrize("centre", [np.zeros(3), np.array([3.0, -7.0, 4.0]), np.array([3.0e5, -7.0e5, 4.0e5])])
def test_moments_equal_their_definition_however_far_the_offset_is(centre):
    rng = np.random.default_rng(1)
    xyz = uniform(rng, 20_000) * [1.0, 1.3, 0.8] + rng.normal(size=(20_000, 3)) * 0.01 + centre
    got = streamed(xyz).cubes().about(centre, 1.1).sum(axis=0)
    np.testing.assert_allclose(got, by_definition(xyz, centre, 1.1), atol=2e-9 * len(xyz), rtol=0)


def test_a_first_sample_that_is_a_spike_costs_no_digits_of_the_others():
    xyz = uniform(np.random.default_rng(2), 5000) * 50.0
    cubes = streamed(np.vstack([[1.0e6, -1.0e6, 1.0e6], xyz])).cubes()
    near = cubes.only(np.linalg.norm(cubes.means, axis=1) < 100.0)
    np.testing.assert_allclose(
        near.about(np.zeros(3), 50.0).sum(axis=0), by_definition(xyz, np.zeros(3), 50.0), atol=1e-8
    )


@pytest.mark.parametrize("cuts", [[1], [1, 2, 3, 2500], list(range(50, 4000, 50))])
def test_cutting_the_stream_changes_no_bit(cuts):
    xyz = hand_sweep(3, 4000) + np.array([0.4, 0.1, -0.2])
    whole, cut = streamed(xyz).cubes(), streamed(xyz, cuts).cubes()
    np.testing.assert_array_equal(whole.moments, cut.moments)
    np.testing.assert_array_equal(whole.origins, cut.origins)
    assert whole.roughness == cut.roughness


def test_order_changes_the_total_by_rounding_only():
    xyz = hand_sweep(4, 4000) + np.array([0.4, 0.1, -0.2])
    mixed = np.random.default_rng(0).permutation(xyz)
    first, second = (streamed(x).cubes().about(np.zeros(3), 1.0).sum(axis=0) for x in (xyz, mixed))
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_memory_is_the_same_after_a_million_samples():
    rng = np.random.default_rng(5)
    stream, block = MomentStream(), uniform(rng, 20_000)

    def held():
        return sum(v.nbytes for v in vars(stream).values() if isinstance(v, np.ndarray))

    stream.feed(block[:1])
    at_first = held()
    for _ in range(50):
        stream.feed(block + rng.normal(size=block.shape) * 0.01)
    assert stream.samples == 1_000_001
    assert held() == at_first < 1e6
    assert len(stream.cubes().origins) <= CUBES


def test_points_stay_spread_over_the_whole_sphere_not_over_the_newest_part():
    u = uniform(np.random.default_rng(6), 40_000)
    early, late = u[u[:, 2] > 0], u[u[:, 2] < 0]
    points = streamed(np.vstack([early, late])).cubes().origins
    upper = np.mean(points[:, 2] > 0)
    assert 0.4 < upper < 0.6
    assert len(points) > 500


def test_what_is_not_finite_is_counted_and_left_out():
    xyz = uniform(np.random.default_rng(7), 100)
    bad = xyz.copy()
    bad[[0, 3, 50], [0, 1, 2]] = [np.nan, np.inf, -np.inf]
    stream = streamed(bad)
    assert (stream.samples, stream.left_out) == (97, 3)
    expected = by_definition(np.delete(xyz, [0, 3, 50], axis=0), np.zeros(3), 1.0)
    np.testing.assert_allclose(stream.cubes().about(np.zeros(3), 1.0).sum(axis=0), expected, atol=1e-10)


def test_roughness_is_the_standard_deviation_of_white_noise():
    xyz = np.random.default_rng(8).normal(size=(50_000, 3)) * 0.3 + 5.0
    assert streamed(xyz).cubes().roughness == pytest.approx(0.3, rel=0.02)


def test_a_sensor_that_wakes_up_with_zeros_loses_only_them():
    xyz = uniform(np.random.default_rng(9), 500) * 0.5 + 0.1
    stream = streamed(np.vstack([np.zeros((3, 3)), xyz]), cuts=[2])
    assert (stream.samples, stream.left_out) == (500, 3)
