"""The fit: known truths come back within 3σ, without bias; turning, scaling, ordering change only what they must."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.ellipsoid_moments import EXPONENTS
from server.nav.calibration.ellipsoid_solve import adjusted
from server.nav.calibration.mag_ellipsoid import fit_ellipsoid
from tests.calibration.ellipsoid_truth import (
    S0_CENTRE,
    S0_RADII,
    ellipsoid,
    geometric_fit,
    hand_sweep,
    s0_fit,
    slow_noise,
    uniform,
)

S0_SIZE = float(np.prod(S0_RADII) ** (1 / 3))


def tilted(seed):
    """A symmetric matrix with S0's half axes along axes of no particular direction."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return turn @ np.diag(1.0 / S0_RADII) @ turn.T


def share_beyond(fits, offset, matrices, limit=3.0):
    """Share of all parameters farther from the truth than `limit` σ."""
    pairs = zip(fits, matrices, strict=True)
    z = [(fit.parameters["offset"] - offset) / fit.sigma["offset"] for fit in fits]
    upper = np.triu_indices(3)
    z += [
        ((fit.parameters["matrix"] - m) / np.where(fit.sigma["matrix"] > 0, fit.sigma["matrix"], 1.0))[upper]
        for fit, m in pairs
    ]
    return np.mean(np.abs(np.concatenate(z)) > limit)


@pytest.mark.parametrize("parameters", [6, 9])
def test_the_seeds_ellipsoid_comes_back_within_three_sigma(parameters):
    matrix, fits = np.diag(1.0 / S0_RADII), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        xyz = ellipsoid(uniform(rng, 600), S0_CENTRE, matrix) + rng.normal(size=(600, 3)) * 5.0
        fits.append(fit_ellipsoid(xyz, parameters))
    assert all(fit.ok for fit in fits)
    assert share_beyond(fits, S0_CENTRE, [matrix] * 40) == 0.0
    errors = [np.linalg.norm(fit.parameters["offset"] - S0_CENTRE) for fit in fits]
    assert max(errors) < 0.004 * S0_SIZE


@pytest.mark.parametrize("steps", [0.0, 10.0, 50.0])
def test_tilted_ellipsoids_from_hand_sweeps_come_back_within_three_sigma_whatever_the_noise_s_colour(steps):
    fits, matrices = [], [tilted(seed) for seed in range(10)]
    for seed, matrix in enumerate(matrices):
        rng = np.random.default_rng(seed)
        noise = slow_noise(rng, 2000, steps, 4.75) if steps else rng.normal(size=(2000, 3)) * 4.75
        fits.append(fit_ellipsoid(ellipsoid(hand_sweep(seed), S0_CENTRE, matrix) + noise))
    assert all(fit.ok for fit in fits)
    assert share_beyond(fits, S0_CENTRE, matrices) <= 0.02
    wide = np.mean([np.linalg.norm(fit.sigma["offset"]) for fit in fits])
    assert wide < 0.02 * S0_SIZE  # not bought by a σ that says nothing


def test_exact_data_gives_the_exact_matrix():
    matrix = tilted(3)
    fit = fit_ellipsoid(ellipsoid(hand_sweep(1), S0_CENTRE, matrix))
    np.testing.assert_allclose(fit.parameters["offset"], S0_CENTRE, atol=1e-6 * S0_SIZE)
    np.testing.assert_allclose(fit.parameters["matrix"] * S0_SIZE, matrix * S0_SIZE, atol=1e-6)


def test_adjusted_moments_of_noisy_samples_have_the_mean_of_the_clean_ones():
    """The law behind the fit: E[t(x + noise)] = x^k; ordinary fourth moments are off by 6 x² s + 3 s²."""
    rng = np.random.default_rng(0)
    clean, s = np.array([0.8, -0.5, 0.3]), 0.04
    noisy = clean + rng.normal(size=(400_000, 3)) * np.sqrt(s)
    raw = np.array([np.mean(noisy[:, 0] ** i * noisy[:, 1] ** j * noisy[:, 2] ** k) for i, j, k in EXPONENTS])
    true = np.array([clean[0] ** i * clean[1] ** j * clean[2] ** k for i, j, k in EXPONENTS])
    assert np.abs(raw - true).max() > 0.1
    np.testing.assert_allclose(adjusted(raw, s), true, atol=0.004)


def test_strong_noise_does_not_shrink_or_shift_it_where_ordinary_least_squares_does():
    rng = np.random.default_rng(4)
    u = uniform(rng, 60_000)
    u = u[(u[:, 0] > -0.5) | (rng.random(len(u)) < 0.2)]  # fewer on one side
    xyz = u + rng.normal(size=u.shape) * 0.05
    fit = fit_ellipsoid(xyz)
    d = np.column_stack([xyz**2, xyz[:, [0, 0, 1]] * xyz[:, [1, 2, 2]], xyz])
    w = np.linalg.lstsq(d, np.ones(len(xyz)), rcond=None)[0]
    a = np.array([[w[0], w[3] / 2, w[4] / 2], [w[3] / 2, w[1], w[5] / 2], [w[4] / 2, w[5] / 2, w[2]]])
    ordinary = np.linalg.solve(a, -0.5 * w[6:9])
    assert np.linalg.norm(fit.parameters["offset"]) < 0.002
    assert np.linalg.norm(ordinary) > 2.0 * np.linalg.norm(fit.parameters["offset"])
    np.testing.assert_allclose(fit.parameters["matrix"], np.eye(3), atol=0.004)


def test_it_agrees_with_a_geometric_fit_within_its_sigma():
    rng = np.random.default_rng(9)
    xyz = ellipsoid(hand_sweep(9), S0_CENTRE, tilted(9)) + rng.normal(size=(2000, 3)) * 5.0
    fit, (offset, matrix) = fit_ellipsoid(xyz), geometric_fit(xyz)
    assert np.all(np.abs(fit.parameters["offset"] - offset) < fit.sigma["offset"])
    # noise lengthens every reading by s²/R, which a geometric fit takes for size: 1e-4 here
    np.testing.assert_allclose(fit.parameters["matrix"] * S0_SIZE, matrix * S0_SIZE, atol=5e-4)


def sweep_with_noise():
    rng = np.random.default_rng(12)
    return ellipsoid(hand_sweep(12, 1500), S0_CENTRE, tilted(12)) + rng.normal(size=(1500, 3)) * 4.0


def test_turning_the_sensor_turns_the_result():
    xyz, turn = sweep_with_noise(), Rotation.random(random_state=5).as_matrix()
    fit, turned = fit_ellipsoid(xyz), fit_ellipsoid(xyz @ turn.T)
    np.testing.assert_allclose(turned.parameters["offset"], turn @ fit.parameters["offset"], atol=1e-7)
    np.testing.assert_allclose(turned.parameters["matrix"], turn @ fit.parameters["matrix"] @ turn.T, atol=1e-11)


@pytest.mark.parametrize("factor", [1e-4, 0.01, 7.3, 1e5])
def test_another_unit_scales_the_offset_and_nothing_else(factor):
    xyz = sweep_with_noise()
    fit, scaled = fit_ellipsoid(xyz), fit_ellipsoid(xyz * factor)
    np.testing.assert_allclose(scaled.parameters["offset"], fit.parameters["offset"] * factor, rtol=1e-8)
    np.testing.assert_allclose(
        scaled.parameters["matrix"], fit.parameters["matrix"] / factor, rtol=1e-8, atol=1e-12 / factor
    )
    np.testing.assert_allclose(scaled.sigma["offset"], fit.sigma["offset"] * factor, rtol=1e-6)
    assert scaled.grade == fit.grade


def test_the_order_of_the_samples_changes_nothing():
    xyz = sweep_with_noise()
    fit, mixed = fit_ellipsoid(xyz), fit_ellipsoid(np.random.default_rng(1).permutation(xyz))
    np.testing.assert_allclose(mixed.parameters["offset"], fit.parameters["offset"], atol=1e-7)
    np.testing.assert_allclose(mixed.parameters["matrix"], fit.parameters["matrix"], atol=1e-11)


def test_the_order_of_the_axes_changes_only_the_names_of_the_axes_unlike_with_the_seeds_form():
    rng = np.random.default_rng(13)
    xyz = ellipsoid(hand_sweep(13, 1500), S0_CENTRE, np.diag(1.0 / S0_RADII)) + rng.normal(size=(1500, 3)) * 15.0
    order = [2, 0, 1]
    fit, other = fit_ellipsoid(xyz, 6), fit_ellipsoid(xyz[:, order], 6)
    np.testing.assert_allclose(other.parameters["offset"], np.asarray(fit.parameters["offset"])[order], atol=1e-7)
    assert np.abs(s0_fit(xyz[:, order]) - s0_fit(xyz)[order]).max() > 0.05
    assert np.linalg.norm(s0_fit(xyz) - S0_CENTRE) < 0.02 * S0_SIZE  # the comparison itself is the seeds' fit


def test_strength_scales_the_matrix_only():
    xyz = sweep_with_noise()
    one, half = fit_ellipsoid(xyz), fit_ellipsoid(xyz, strength=0.5)
    np.testing.assert_allclose(half.parameters["matrix"], 0.5 * one.parameters["matrix"], rtol=1e-12)
    np.testing.assert_allclose(half.parameters["offset"], one.parameters["offset"], rtol=1e-12)
    lengths = np.linalg.norm((xyz - half.parameters["offset"]) @ half.parameters["matrix"], axis=1)
    assert lengths.mean() == pytest.approx(0.5, rel=1e-3)
    assert half.residual_after.value == pytest.approx(np.sqrt(np.mean((lengths - 0.5) ** 2)), rel=0.02)


def test_the_matrix_is_symmetric_and_positive():
    matrix = fit_ellipsoid(sweep_with_noise()).parameters["matrix"]
    np.testing.assert_array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    axis_aligned = fit_ellipsoid(ellipsoid(hand_sweep(2), S0_CENTRE, np.diag(1.0 / S0_RADII)), 6).parameters["matrix"]
    np.testing.assert_array_equal(axis_aligned, np.diag(np.diag(axis_aligned)))


def test_residual_before_is_the_spread_of_the_raw_lengths():
    xyz = sweep_with_noise()
    lengths = np.linalg.norm(xyz, axis=1)
    assert fit_ellipsoid(xyz).residual_before.value == pytest.approx(lengths.std() / lengths.mean(), rel=1e-6)


@pytest.mark.parametrize("spikes", [1, 5, 20])
@pytest.mark.parametrize("size", [1.3, 3.0, 1e3, 1e6])
def test_a_few_spikes_are_left_out_and_counted(spikes, size):
    clean = sweep_with_noise()
    dirty = clean.copy()
    rng = np.random.default_rng(spikes)
    rows = rng.choice(len(dirty), spikes, replace=False)
    dirty[rows] = S0_CENTRE + uniform(rng, spikes) * S0_SIZE * size
    fit, without = fit_ellipsoid(dirty), fit_ellipsoid(np.delete(clean, rows, axis=0))
    assert fit.ok
    assert fit.details["rejected"] == spikes
    np.testing.assert_allclose(fit.parameters["offset"], without.parameters["offset"], atol=1e-6 * S0_SIZE)
