"""The collector: what must be refused is, with its reason; what is right is accepted; progress tells the truth."""

import numpy as np
import pytest

from server.nav.calibration.mag_ellipsoid import MagEllipsoid, fit_ellipsoid
from server.nav.calibration.types import Options
from server.nav.types import ROW_WIDTH, Kind
from tests.calibration.ellipsoid_truth import ellipsoid, hand_sweep, uniform

FIELD = (0.2, 0.02, 0.45)
STRENGTH = float(np.linalg.norm(FIELD))
OFFSET = np.array([0.12, -0.3, 0.21])
MATRIX = np.array([[1.05, 0.03, -0.02], [0.03, 0.95, 0.04], [-0.02, 0.04, 1.02]])


def readings(directions, noise=0.003, seed=0):
    """Raw readings in gauss of an uncalibrated sensor in the field of this place."""
    xyz = ellipsoid(directions * STRENGTH, OFFSET, MATRIX)
    return xyz + np.random.default_rng(seed).normal(size=xyz.shape) * noise


def rows_of(xyz, first=0):
    rows = np.full((len(xyz), ROW_WIDTH), np.nan)
    rows[:, first : first + 3] = xyz
    return rows


def collected(xyz, **options):
    collector = MagEllipsoid(Options(**({"field_n_gauss": FIELD} | options)))
    collector.feed(Kind.MAG, np.arange(len(xyz), dtype=np.int64) * 20_000_000, rows_of(xyz))
    return collector


def refusal(xyz, **options):
    fit = collected(xyz, **options).fit()
    assert not fit.parameters
    return fit.failure.code if fit.failure else ""


def turns_about(axis, tilt_rad, count=1500, wobble_rad=0.0, seed=0):
    """Field directions while the board spins about one axis that stands at `tilt_rad` to the field."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, count)
    cone = tilt_rad + rng.normal(size=count) * wobble_rad
    flat = np.stack([np.sin(cone) * np.cos(angle), np.sin(cone) * np.sin(angle), np.cos(cone)], axis=1)
    return np.roll(flat, axis, axis=1)


ALL = uniform(np.random.default_rng(1), 3000)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("tilt_deg", [90.0, 60.0, 30.0])
@pytest.mark.parametrize("wobble_deg", [0.0, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_turning_about_one_axis_only_is_refused_as_planar(axis, tilt_deg, wobble_deg, noise):
    spin = turns_about(axis, np.radians(tilt_deg), wobble_rad=np.radians(wobble_deg))
    assert refusal(readings(spin, noise)) == "coverage-planar"


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_half_a_sphere_is_refused_as_poor_coverage(axis, side, noise):
    assert refusal(readings(ALL[ALL[:, axis] * side > 0], noise)) == "coverage-poor"


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_band_of_twenty_degrees_is_refused(axis, noise):
    band = ALL[np.abs(ALL[:, axis]) < np.sin(np.radians(20))]
    assert refusal(readings(band, noise)) in {"coverage-poor", "coverage-planar"}


def test_a_board_that_lies_still_is_refused():
    assert refusal(readings(np.tile([[0.6, 0.0, 0.8]], (2000, 1)))) == "coverage-poor"


def test_a_small_cap_is_refused():
    assert refusal(readings(ALL[ALL[:, 2] > np.cos(np.radians(40))])).startswith("coverage")


@pytest.mark.parametrize(("count", "code"), [(0, "no-data"), (10, "too-few-samples")])
def test_too_little_data_is_refused(count, code):
    assert refusal(readings(ALL[:count])) == code


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_a_field_that_is_not_the_earths_is_refused_where_it_is_known_and_only_there(factor):
    xyz = readings(ALL) * factor
    assert refusal(xyz) == "field-strength"
    assert refusal(xyz, field_n_gauss=(), strength=STRENGTH) == "field-strength"
    assert collected(xyz, field_n_gauss=()).fit().ok
    assert collected(xyz, unit="raw", strength=STRENGTH).fit().ok


def test_a_sensor_at_its_range_is_refused_as_saturated():
    xyz = readings(ALL)
    limit = OFFSET[0] + 0.75 * STRENGTH
    assert refusal(np.minimum(xyz, [limit, np.inf, np.inf])) == "saturated"


def test_an_overflow_code_now_and_then_is_left_out():
    xyz = readings(ALL)
    xyz[::50, 0] = -40.96
    fit = collected(xyz).fit()
    assert fit.ok
    assert fit.details["rejected"] == 60
    assert np.linalg.norm(fit.parameters["offset"] - OFFSET) < 0.003 * STRENGTH


@pytest.mark.parametrize(
    "xyz",
    [
        np.full((500, 3), 0.3),
        np.zeros((500, 3)),
        np.full((500, 3), np.nan),
        np.outer(np.linspace(0.0, 1.0, 500), [1.0, 2.0, 3.0]),
        np.repeat([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], 100, axis=0),
        np.random.default_rng(0).uniform(-1, 1, (3000, 3)),
        np.random.default_rng(0).normal(size=(3000, 3)),
        np.random.default_rng(0).normal(size=(500, 3)) * 1e200,
        np.random.default_rng(0).normal(size=(500, 3)) * 1e-200,
        np.vstack([readings(ALL), readings(ALL) + np.array([0.3, 0.0, 0.0])]),
    ],
)
@pytest.mark.parametrize("parameters", [6, 9])
def test_what_is_no_ellipsoid_is_refused_without_a_warning(xyz, parameters):
    collector = collected(xyz, field_n_gauss=(), ellipsoid_parameters=parameters)
    assert collector.fit().failure is not None
    assert not collector.progress().is_enough
    assert not collector.check({"offset": np.zeros(3), "matrix": np.eye(3)}).ok


def test_coarse_counts_are_not_taken_for_saturation():
    coarse = np.round(readings(ALL, 0.0) / (STRENGTH / 30.0))
    fit = collected(coarse, unit="raw", field_n_gauss=()).fit()
    assert fit.ok
    np.testing.assert_allclose(fit.parameters["offset"] * STRENGTH / 30.0, OFFSET, atol=0.01 * STRENGTH)


def test_a_field_that_changes_with_the_place_is_told_from_noise():
    u = hand_sweep(3, 3000)
    slow = 0.25 * STRENGTH * np.sin(np.arange(3000) / 150.0)[:, None] * [0.3, 1.0, 0.5]
    assert refusal(readings(u) + slow) == "field-uneven"
    assert refusal(readings(u, noise=0.12 * STRENGTH)) == "residual"


def test_a_tilted_ellipsoid_is_not_forced_onto_the_axes():
    tilted = np.array([[1.0, 0.25, 0.1], [0.25, 1.0, -0.2], [0.1, -0.2, 1.0]])
    xyz = ellipsoid(ALL, np.array([0.3, 0.1, 0.0]), tilted)
    assert fit_ellipsoid(xyz, 6).failure.code == "residual"
    np.testing.assert_allclose(fit_ellipsoid(xyz, 9).parameters["matrix"], tilted, atol=1e-9)


def test_long_rest_before_and_after_turning_does_not_spoil_it():
    rest = np.tile([[0.6, 0.0, 0.8]], (6000, 1))
    fit = collected(readings(np.vstack([rest, hand_sweep(5, 2500), rest]))).fit()
    assert fit.ok
    assert np.linalg.norm(fit.parameters["offset"] - OFFSET) < 0.005 * STRENGTH


def test_the_result_has_its_strength_and_says_how_good_it_is():
    xyz = readings(ALL)
    fit = collected(xyz).fit()
    lengths = np.linalg.norm((xyz - fit.parameters["offset"]) @ fit.parameters["matrix"], axis=1)
    assert lengths.mean() == pytest.approx(STRENGTH, rel=1e-3)
    assert (fit.residual_after.unit, fit.grade) == ("gauss", "good")
    assert fit.residual_after.value == pytest.approx(0.003, rel=0.1)
    assert fit.residual_before.value > 20 * fit.residual_after.value
    assert fit.coverage == 1.0
    assert np.linalg.norm(fit.parameters["offset"] - OFFSET) < 0.003 * STRENGTH


def test_more_noise_makes_a_worse_grade():
    grades = [collected(readings(ALL, noise * STRENGTH)).fit().grade for noise in (0.01, 0.03, 0.05)]
    assert grades == ["good", "fair", "poor"]


def test_progress_grows_with_what_was_covered_and_never_claims_a_fit_that_would_be_refused():
    u, collector = hand_sweep(7, 4000), MagEllipsoid(Options(field_n_gauss=FIELD))
    xyz, shares = readings(u), []
    for at in range(0, 4000, 100):
        t_ns = np.arange(at, at + 100, dtype=np.int64) * 20_000_000
        collector.feed(Kind.MAG, t_ns, rows_of(xyz[at : at + 100]))
        seen = collector.progress()
        shares.append(seen.fraction)
        assert seen.is_enough == collector.fit().ok
        assert len(seen.points) <= 1500
    assert shares[0] < 0.2
    assert np.diff(shares).min() > -0.1
    assert seen.is_complete
    assert (seen.fraction, seen.instruction) == (1.0, "done")


def test_a_far_offset_does_not_make_the_sphere_look_covered_or_not():
    near = collected(readings(ALL[ALL[:, 0] > -0.5])).progress()
    far = collected(readings(ALL[ALL[:, 0] > -0.5]) + np.array([30.0, -20.0, 50.0])).progress()
    assert near.values["coverage"] == pytest.approx(far.values["coverage"], abs=0.02)
    assert 0.7 < far.values["coverage"] < 0.85  # 3/4 of the sphere, and the cells that its edge cuts


def test_rest_alone_is_no_progress():
    seen = collected(readings(np.tile([[0.6, 0.0, 0.8]], (5000, 1)))).progress()
    assert seen.fraction <= 0.1
    assert not seen.is_enough
    assert len(seen.uncovered_b) == 100


def test_uncovered_directions_are_those_that_were_left_out():
    seen = collected(readings(ALL[ALL[:, 2] < 0.6])).progress()
    assert len(seen.uncovered_b) > 8
    assert np.all(seen.uncovered_b[:, 2] > 0.5)


def test_the_pose_asked_for_puts_the_field_into_the_hole():
    """Held with that side down, and turned about the vertical, the field reaches the missing directions."""
    hole = np.array([0.0, 0.0, 1.0])
    u = ALL[ALL @ hole < 0.4]
    field = np.array(FIELD) / STRENGTH
    collector = collected(readings(u))
    rng = np.random.default_rng(3)
    dip_cosine = field[2]
    side = rng.normal(size=3)
    down = dip_cosine * u[-1] + np.sqrt(1 - dip_cosine**2) * np.cross(u[-1], side) / np.linalg.norm(
        np.cross(u[-1], side)
    )
    collector.feed(Kind.IMU, np.array([0]), rows_of(-9.8 * down[None], first=3))
    target = np.array(collector.progress().pose_target_b)
    assert np.linalg.norm(target) == pytest.approx(1.0)
    angle_field_down = np.arccos(dip_cosine)
    assert np.arccos(target @ hole) < angle_field_down + np.radians(30)


def test_verification_accepts_the_result_on_fresh_data_and_refuses_the_raw_sensor():
    fit = collected(readings(ALL)).fit()
    fresh = collected(readings(hand_sweep(11, 600), seed=9))
    good = fresh.check(fit.parameters)
    raw = fresh.check({"offset": np.zeros(3), "matrix": np.eye(3)})
    assert good.ok
    assert good.residual.value == pytest.approx(0.003, rel=0.2)
    assert not raw.ok
    lengths = np.linalg.norm(readings(hand_sweep(11, 600), seed=9), axis=1)
    assert raw.residual.value == pytest.approx(np.sqrt(np.mean((lengths - STRENGTH) ** 2)), rel=0.03)


def test_verification_wants_more_than_one_direction():
    fit = collected(readings(ALL)).fit()
    still = collected(readings(np.tile([[0.6, 0.0, 0.8]], (500, 1)))).check(fit.parameters)
    assert not still.ok
    assert still.failure.code == "coverage-poor"


def test_impossible_options_are_refused_at_once():
    with pytest.raises(ValueError, match="6 or 9"):
        MagEllipsoid(Options(ellipsoid_parameters=7))
    with pytest.raises(ValueError, match="positive"):
        MagEllipsoid(Options(strength=-1.0))
