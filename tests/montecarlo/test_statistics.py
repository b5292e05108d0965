"""Laws of the Monte Carlo statistics, on errors whose covariance is known."""

import math

import numpy as np
import pytest

from server.montecarlo.campaign import Campaign
from server.montecarlo.flight import Flight
from server.montecarlo.results import results
from server.montecarlo.statistics import nees, nees_curves, nis_curves, rms
from server.nav.types import Aid
from server.sim import SimSettings

EPOCHS = 240
SCALE = np.repeat([1e-3, 0.05, 0.4], 3)


def mixing(rng):
    """A covariance with strong correlations between states of very different size."""
    mix = rng.standard_normal((9, 9)) + 3.0 * np.eye(9)
    return SCALE[:, None] * mix


def flights(n=60, factor=1.0, seed=1):
    rng = np.random.default_rng(seed)
    mix = mixing(rng)
    P = mix @ mix.T
    made = []
    for _ in range(n):
        nis = np.full((len(Aid), EPOCHS, 3), np.nan)
        nis[Aid.GNSS_VELOCITY] = factor * rng.standard_normal((EPOCHS, 3))
        nis[Aid.BARO_HEIGHT, ::2, 0] = factor * rng.standard_normal(EPOCHS // 2)
        made.append(
            Flight(
                board=SimSettings(),
                error=factor * (rng.standard_normal((EPOCHS, 9)) @ mix.T),
                sigma=np.tile(np.sqrt(np.diag(P)), (EPOCHS, 1)),
                P=np.tile(P, (EPOCHS, 1, 1)),
                nis=nis,
                status=np.full(EPOCHS, 2),
            )
        )
    return made


def test_nees_is_the_quadratic_form_whatever_the_units():
    rng = np.random.default_rng(2)
    mix = mixing(rng)
    P, e = mix @ mix.T, mix @ rng.standard_normal(9)
    assert nees(e[None], P[None])[0] == pytest.approx(e @ np.linalg.inv(P) @ e, rel=1e-6)
    assert math.isnan(nees(np.append(e[:8], np.nan)[None], P[None])[0])


@pytest.mark.parametrize("curves", [lambda f: nees_curves(f, full=True), nis_curves], ids=["nees", "nis"])
def test_a_consistent_filter_is_inside_its_bound_at_19_epochs_of_20(curves):
    for curve in curves(flights()):
        assert 0.91 <= curve.share("inside") <= 0.99
        assert curve.average() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("factor", "side"), [(1.3, "above"), (0.75, "below")])
def test_a_sigma_a_quarter_off_is_outside_on_the_right_side(factor, side):
    for curve in nees_curves(flights(factor=factor), full=True):
        assert curve.share(side) >= 0.9
        assert curve.average() == pytest.approx(factor**2, rel=0.05)


def test_sigma_alone_has_the_mean_of_the_full_covariance_but_not_its_spread():
    """Its expectation is 1 per component either way; correlated components vary more than the bound says."""
    made = flights()
    alone, full = nees_curves(made, full=False)[-1], nees_curves(made, full=True)[-1]
    assert alone.average() == pytest.approx(1.0, abs=0.05)
    assert alone.share("inside") < full.share("inside")


def test_the_bound_is_the_one_of_runs_times_dimension():
    curve = nees_curves(flights(50), full=True)[0]
    assert curve.low[0] * 3 == pytest.approx(2.36, abs=0.01)  # χ²(0.025; 150)/50 = 117.98/50
    assert curve.high[0] * 3 == pytest.approx(3.72, abs=0.01)  # χ²(0.975; 150)/50 = 185.80/50


def test_an_epoch_that_most_flights_do_not_know_does_not_count():
    made = flights(10)
    for flight in made[:6]:
        flight.error[:40] = np.nan
    curve = nees_curves(made, full=True)[0]
    assert not curve.known[:40].any()
    assert curve.known[40:].all()


def test_a_slow_aid_counts_at_its_own_epochs():
    baro = next(curve for curve in nis_curves(flights()) if curve.name == "baro_height")
    assert baro.known[::2].all()
    assert not baro.known[1::2].any()


def test_rms_is_over_the_flights_that_know():
    made = flights(4)
    made[0].error[3] = np.nan
    error, _ = rms(made)
    expected = np.sqrt(np.mean([flight.error[3] ** 2 for flight in made[1:]], axis=0))
    np.testing.assert_allclose(error[3], expected)


def test_a_campaign_passes_on_its_real_aids_and_fails_by_name():
    campaign = Campaign(runs=60)
    made = flights()
    for flight in made:
        flight.nis[Aid.ZERO_VELOCITY] = 0.01
    found = results(campaign, made)
    assert found["passed"]
    assert found["covariance"] == "full"
    assert found["nis"]["zero_velocity"]["below"] == 1.0  # told, but nothing is demanded of an assumption
    for flight in made:
        flight.nis[Aid.BARO_HEIGHT] *= 2.0
    found = results(campaign, made)
    assert found["failing"] == ["baro_height"]
    assert not found["passed"]
