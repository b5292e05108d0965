"""A small campaign, flown for real: bytes of the demo board through protocol and engine."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from server.cli import app
from server.montecarlo.campaign import LANE, Campaign
from server.montecarlo.command import CampaignError, as_json, checked, montecarlo
from server.montecarlo.flight import fly
from server.montecarlo.report import html, text
from server.montecarlo.run import run_campaign
from server.nav.engine import NavEngine
from server.nav.lanes.ins_ekf import InsEkf
from server.nav.types import Aid, LaneStatus
from server.replay.score import rotation_between

SMALL = Campaign(runs=4, seconds=20.0, seed=5)


@pytest.fixture(scope="module")
def small():
    return run_campaign(SMALL, processes=1)


@pytest.fixture(scope="module")
def figures():
    return montecarlo(SMALL, out=None, quiet=True)


def same(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("error", "sigma", "P", "nis", "status")
    )


def test_every_flight_aligns_navigates_and_is_examined(small):
    for flight in small:
        assert flight.status[-1] == LaneStatus.NAVIGATING
        assert np.isfinite(flight.error[-1]).all()
        assert np.isfinite(flight.sigma[-1]).all()
        assert np.isnan(flight.error[0, 3:]).all()  # half a second after power-up there is an attitude at most
        assert np.linalg.norm(flight.error[-1, 6:]) < 5.0
        assert np.isfinite(flight.nis[Aid.BARO_HEIGHT, -4:, 0]).any()


def test_the_covariance_told_is_that_of_the_published_sigma(small):
    """A lane that tells its covariance tells it at every epoch at which it publishes position."""
    for flight in small:
        known = np.isfinite(flight.P).all(axis=(1, 2))
        assert (known == (np.isfinite(flight.sigma).all(axis=1) & hasattr(InsEkf, "covariance"))).all()
        variances = np.diagonal(flight.P[known], axis1=1, axis2=2)
        np.testing.assert_allclose(np.sqrt(variances), flight.sigma[known], rtol=1e-9)


@pytest.mark.parametrize(("late_ns", "told"), [(0, True), (20_000_000, False)])
def test_a_covariance_counts_only_when_it_is_of_the_very_state_that_is_published(monkeypatch, late_ns, told):
    def covariance(engine, lane):
        return engine.snapshot().t_ns - late_ns, 4.0 * np.eye(9)

    monkeypatch.setattr(NavEngine, "covariance", covariance)
    flight = fly(Campaign(runs=2, seconds=10.0), 0)
    assert np.isfinite(flight.P[-1]).all() == told
    assert np.isnan(flight.P[0, 3:, 3:]).all()


def test_the_same_campaign_is_the_same_bit_for_bit_on_two_processes(small):
    again = run_campaign(SMALL, processes=2)
    assert all(same(one, other) for one, other in zip(small, again, strict=True))


def test_flights_differ_in_seed_wind_and_errors(small):
    boards = [flight.board for flight in small]
    assert len({board.seed for board in boards}) == len({board.wind_m_s for board in boards}) == 4
    assert not same(small[0], small[1])


def test_another_seed_is_another_campaign_and_more_runs_begin_alike():
    assert Campaign(seed=5).board(0) != Campaign(seed=6).board(0)
    assert Campaign(runs=4, seed=5).board(3) == Campaign(runs=100, seed=5).board(3)


def test_told_the_data_sheets_means_the_lane_gets_other_noise():
    assert Campaign(told="defaults").engine().lane_parameters == {}
    told = Campaign(told="sheet").engine().lane_parameters[LANE]
    assert told["gyro_noise_rad_s_rthz"] == pytest.approx(np.radians(0.005))


def test_the_json_has_every_curve_at_every_epoch(figures):
    found = json.loads(as_json(figures))
    assert len(found["epochs_s"]) == 40
    assert set(found["nees_diagonal"]) == {"attitude", "velocity", "position", "all nine"}
    assert {"gnss_position", "gnss_velocity", "baro_height", "mag_field"} <= set(found["nis"])
    for one in [*found["nees_diagonal"].values(), *found["nis"].values()]:
        assert {len(one[key]) for key in ("mean", "low", "high")} == {40}
        assert one["inside"] + one["above"] + one["below"] == pytest.approx(1.0)
    assert len(found["flights"]) == 4
    assert all(flight["events"]["aligned"] == 1 for flight in found["flights"])
    assert isinstance(found["passed"], bool)
    for one in found["components"].values():
        assert len(one["rms_error"]) == len(one["rms_sigma"]) == 40


def test_the_report_names_every_quantity_and_the_verdict(figures):
    shown = text(figures)
    assert "NIS gnss_velocity" in shown
    assert "NEES attitude" in shown
    assert "onsistent" in shown
    page = html(figures)
    assert page.startswith("<!doctype html>")
    assert "http" not in page.split("<body>")[1].replace("http://www.w3.org", "")


def test_the_command_writes_both_files(tmp_path):
    ran = CliRunner().invoke(app, ["montecarlo", "--runs", "2", "--seconds", "12", "--out", str(tmp_path / "mc")])
    assert ran.exit_code == 0, ran.output
    assert "2 flights of 12 s" in ran.output
    found = json.loads((tmp_path / "mc" / "montecarlo.json").read_bytes())
    assert found["campaign"]["runs"] == 2
    assert (tmp_path / "mc" / "montecarlo.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    "wrong", [{"runs": 1}, {"seconds": 5.0}, {"seed": -1}, {"told": "lies"}], ids=lambda wrong: next(iter(wrong))
)
def test_what_cannot_be_flown_is_refused_with_the_option_named(wrong):
    with pytest.raises(CampaignError, match=f"--{next(iter(wrong))}"):
        checked(**({"runs": 4, "seconds": 20.0, "seed": 1, "told": "defaults", "rtk": False} | wrong))


def test_attitude_errors_are_those_of_the_replay_scores():
    """Two modules measure the same rotation, one as lane minus truth, the other as truth minus lane."""
    from server.nav.nees import rotation_errors

    rng = np.random.default_rng(3)
    q = rng.standard_normal((50, 2, 4))
    q /= np.linalg.norm(q, axis=2, keepdims=True)
    np.testing.assert_allclose(rotation_errors(q[:, 0], q[:, 1]), -rotation_between(q[:, 0], q[:, 1]), atol=1e-12)
