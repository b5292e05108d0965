"""Recorded sweeps with published results, and their parts: right ones accepted, poor ones refused."""

import numpy as np
import pytest

from server.nav.calibration.mag_ellipsoid import fit_ellipsoid
from tests.calibration.ellipsoid_truth import geometric_fit, shape_of

# By their authors' programs, both an ellipsoid-specific fit (Li 2004): mag3's output file, michaelwro's script.
PUBLISHED = {
    "mag3": (
        [9955.151669, -7948.26463057, 8511.80447932],
        [
            [0.25060005, 0.02941951, -0.02954944],
            [0.02941951, 0.31691521, 0.00788726],
            [-0.02954944, 0.00788726, 0.30592214],
        ],
    ),
    "michaelwro": (
        [28.557458, -39.981060, -27.428035],
        [[0.989575, -0.022220, 0.005152], [-0.022220, 0.989327, 0.022216], [0.005152, 0.022216, 1.045404]],
    ),
}
FILES = {
    "mag3": ("jremington_mag3_raw.csv", ","),
    "michaelwro": ("michaelwro_mag-readings.txt", None),
    "jremington": ("jremington_mag.txt", None),
}


@pytest.fixture(scope="module")
def sweeps(shared_data):
    return {
        name: np.loadtxt(shared_data / "mag_ellipsoid" / file, delimiter=cut) for name, (file, cut) in FILES.items()
    }


@pytest.mark.parametrize("name", list(PUBLISHED))
def test_published_offset_and_matrix_within_one_percent(sweeps, name):
    fit, (offset, matrix) = fit_ellipsoid(sweeps[name]), PUBLISHED[name]
    assert fit.ok
    assert np.linalg.norm(np.subtract(fit.parameters["offset"], offset)) < 0.005 * fit.details["radius_raw"]
    np.testing.assert_allclose(shape_of(fit.parameters["matrix"]), shape_of(matrix), atol=0.005)


@pytest.mark.parametrize("name", list(FILES))
def test_recorded_sweeps_agree_with_a_geometric_fit_and_are_no_worse_than_fair(sweeps, name):
    fit = fit_ellipsoid(sweeps[name])
    offset, matrix = geometric_fit(sweeps[name])
    assert np.linalg.norm(fit.parameters["offset"] - offset) < 0.01 * fit.details["radius_raw"]
    np.testing.assert_allclose(shape_of(fit.parameters["matrix"]), shape_of(matrix), atol=0.01)
    assert fit.grade in {"good", "fair"}


@pytest.mark.parametrize("name", list(FILES))
def test_half_spheres_bands_and_caps_of_recorded_sweeps_are_refused(sweeps, name):
    xyz = sweeps[name]
    whole = fit_ellipsoid(xyz)
    u = (xyz - whole.parameters["offset"]) @ whole.parameters["matrix"]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    for axis in range(3):
        parts = [u[:, axis] > 0, u[:, axis] < 0, np.abs(u[:, axis]) < np.sin(np.radians(20)), u[:, axis] > 0.5]
        for part in parts:
            fit = fit_ellipsoid(xyz[part])
            assert fit.failure is not None
            assert fit.failure.code in {"coverage-poor", "coverage-planar"}


@pytest.mark.parametrize("name", list(FILES))
def test_what_is_accepted_of_a_recorded_sweep_agrees_with_the_whole(sweeps, name):
    xyz = sweeps[name]
    whole = fit_ellipsoid(xyz)
    radius, accepted = whole.details["radius_raw"], 0
    for parts in (2, 3, 4):
        for part in np.array_split(xyz, parts):
            fit = fit_ellipsoid(part)
            if fit.ok:
                accepted += 1
                off = np.subtract(fit.parameters["offset"], whole.parameters["offset"])
                both = np.hypot(fit.sigma["offset"], whole.sigma["offset"])
                assert np.linalg.norm(off) < 0.04 * radius
                assert np.all(np.abs(off) < 4.0 * both)
    assert accepted >= 3
