"""Laws of the windowed chi-square test: what it says of innovations and errors whose statistics are known."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from server.nav.chi_square import chi_square_quantile, mean_bounds
from server.nav.consistency import ENOUGH, LEAST, MOST, NisBook, Window, lane_verdict, repetition
from server.nav.health import AidBook, consistency
from server.nav.nees import NeesBook, normalised_errors, place_errors, rotation_errors
from server.nav.types import AID_COLUMNS, LANE_COLUMNS, Aid, AidHealth, AidRows, AidStatus, LaneRows

WINDOWS = 400
AT = {name: i for i, name in enumerate(AID_COLUMNS)}
COL = {name: i for i, name in enumerate(LANE_COLUMNS)}


def white(rng, n, sigma=1.0):
    return sigma * rng.standard_normal((n, 3))


def coloured(rng, n, rho):
    x = np.empty((n, 3))
    x[0] = rng.standard_normal(3)
    for k in range(1, n):
        x[k] = rho * x[k - 1] + math.sqrt(1.0 - rho * rho) * rng.standard_normal(3)
    return x


def stamps(n, every_s=0.2, from_s=0.0):
    return np.rint((from_s + every_s * np.arange(n)) * 1e9).astype(np.int64)


def verdicts(make, n=300, windows=WINDOWS):
    rng = np.random.default_rng(7)
    told = []
    for _ in range(windows):
        window = Window()
        window.add(stamps(n), make(rng, n))
        told.append(window.test().verdict)
    return {word: told.count(word) / windows for word in ("over-confident", "conservative", "consistent", "too-few")}


@pytest.mark.parametrize("dof", [0.5, 1.0, 2.7, 10.0, 59.0, 61.0, 900.0])
@pytest.mark.parametrize("probability", [0.0005, 0.025, 0.5, 0.975, 0.9995])
def test_quantiles_are_those_of_the_chi_square_distribution(dof, probability):
    assert chi_square_quantile(probability, dof) == pytest.approx(chi2.ppf(probability, dof), rel=3e-3)


def test_white_unit_innovations_are_consistent_as_often_as_the_level_says():
    share = verdicts(white)
    assert share["consistent"] >= 0.93
    assert share["over-confident"] > 0.0  # five in a hundred fall outside, or the bound were no bound
    assert share["conservative"] > 0.0


def test_a_standard_deviation_told_too_small_by_half_is_over_confident():
    assert verdicts(lambda rng, n: white(rng, n, 2.0))["over-confident"] >= 0.99


def test_a_standard_deviation_told_twice_too_large_is_conservative():
    assert verdicts(lambda rng, n: white(rng, n, 0.5))["conservative"] >= 0.99


def test_ten_percent_of_sigma_shows_in_a_minute_of_ten_a_second():
    assert verdicts(lambda rng, n: white(rng, n, 1.1), n=600)["over-confident"] >= 0.95


@pytest.mark.parametrize("rho", [0.5, 0.8, 0.95])
def test_correlated_unit_innovations_are_consistent_too(rho):
    assert verdicts(lambda rng, n: coloured(rng, n, rho), windows=200)["consistent"] >= 0.90


def test_the_bound_for_white_innovations_would_condemn_correlated_ones():
    rng = np.random.default_rng(3)
    low, high = mean_bounds(3.0 * 300)
    means = [float((coloured(rng, 300, 0.8) ** 2).mean()) for _ in range(200)]
    assert sum(low <= mean <= high for mean in means) / len(means) < 0.8


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9])
def test_the_worth_of_a_first_order_sequence_is_found(rho):
    """Σ ρ^2j: n squares are worth n (1 − ρ²)/(1 + ρ²)."""
    rng = np.random.default_rng(11)
    found = np.mean([repetition(coloured(rng, 2000, rho)[:, 0]) for _ in range(20)])
    assert found == pytest.approx((1 + rho**2) / (1 - rho**2), rel=0.15)


def test_an_error_that_never_changes_is_worth_one_or_two_values():
    assert 300 / repetition(np.full(300, 1.3)) < 2.0
    assert 300 / repetition(np.zeros(300)) == 1.0


def test_a_sine_is_not_taken_for_white_where_it_passes_zero():
    assert repetition(np.sin(np.arange(600) * 2.0 * math.pi / 40.0)) > 10.0


def test_few_samples_get_no_verdict():
    window = Window()
    window.add(stamps(ENOUGH - 1), np.ones((ENOUGH - 1, 3)))
    assert window.test().verdict == "too-few"
    assert window.test().samples == ENOUGH - 1
    assert math.isnan(window.test().low)


def test_the_window_forgets_what_is_older_than_a_minute_but_not_the_newest_fifty():
    rng = np.random.default_rng(1)
    window = Window()
    window.add(stamps(300), white(rng, 300, 5.0))
    window.add(stamps(400, from_s=100.0), white(rng, 400))
    assert window.test().samples == 301
    assert window.test().verdict != "over-confident"
    slow = Window()
    slow.add(stamps(200, every_s=30.0), white(rng, 200))
    assert slow.test().samples == LEAST


def test_memory_is_bounded_whatever_the_rate():
    rng = np.random.default_rng(1)
    window = Window()
    for k in range(20):
        window.add(stamps(1000, every_s=0.001, from_s=float(k)), white(rng, 1000))
    assert window.test().samples == MOST


def test_the_windows_do_not_depend_on_how_the_rows_were_cut():
    rng = np.random.default_rng(5)
    x, t = white(rng, 3000), stamps(3000, every_s=0.05)
    whole, cut = Window(), Window()
    whole.add(t, x)
    for at in range(0, 3000, 7):
        cut.add(t[at : at + 7], x[at : at + 7])
    assert whole.test() == cut.test()


def aid_rows(aid, innovation, variance, status=AidStatus.FUSED, from_s=0.0):
    n = len(innovation)
    data = np.full((n, len(AID_COLUMNS)), np.nan)
    data[:, 0], data[:, 1] = aid, status
    data[:, AT["innovation_0"] : AT["innovation_0"] + 3] = innovation
    data[:, AT["innovation_var_0"] : AT["innovation_var_0"] + 3] = variance
    return AidRows(t_ns=stamps(n, from_s=from_s), data=data)


def nis_of(aid, *parts):
    book = NisBook()
    for rows in parts:
        book.add(rows)
    return book.tests()[aid]


def test_innovations_are_weighed_by_their_own_variance_each():
    rng = np.random.default_rng(2)
    variance = rng.uniform(0.01, 100.0, (280, 3))
    test = nis_of(Aid.GNSS_VELOCITY, aid_rows(Aid.GNSS_VELOCITY, np.sqrt(variance) * white(rng, 280), variance))
    assert test.verdict == "consistent"
    assert test.samples == 280


def test_a_component_without_variance_does_not_count():
    rng = np.random.default_rng(2)
    x = white(rng, 280) * [1.0, 1.0, 50.0]
    test = nis_of(Aid.GNSS_POSITION, aid_rows(Aid.GNSS_POSITION, x, [1.0, 1.0, math.nan]))
    assert test.verdict == "consistent"
    assert test.effective <= 560.0


def test_refused_at_the_gate_counts_and_refused_for_its_quality_does_not():
    rng = np.random.default_rng(2)
    good = aid_rows(Aid.BARO_HEIGHT, white(rng, 200), 1.0)
    wild = white(rng, 60, 40.0)
    gated = aid_rows(Aid.BARO_HEIGHT, wild, 1.0, AidStatus.REFUSED_GATE, from_s=40.0)
    no_fix = aid_rows(Aid.BARO_HEIGHT, wild, 1.0, AidStatus.REFUSED_NO_FIX, from_s=40.0)
    assert nis_of(Aid.BARO_HEIGHT, good, gated).verdict == "over-confident"
    assert nis_of(Aid.BARO_HEIGHT, good, no_fix).verdict == "consistent"


def test_one_glitch_does_not_condemn_a_minute():
    rng = np.random.default_rng(2)
    x = white(rng, 280)
    x[100] = 1e6
    assert nis_of(Aid.GNSS_POSITION, aid_rows(Aid.GNSS_POSITION, x, 1.0)).verdict == "consistent"


def lane(name, t_ns, q_nb, vel, lla, sigma):
    data = np.full((len(t_ns), len(LANE_COLUMNS)), np.nan)
    data[:, :4], data[:, 4:7], data[:, 7:10], data[:, 10:19] = q_nb, vel, lla, sigma
    return LaneRows(lane=name, t_ns=t_ns, data=data)


def flight(rng, n, factor=1.0):
    """A lane at 50 Hz with white errors of `factor` times its σ, and the truth at 100 Hz between its stamps."""
    sigma = np.repeat([1e-3, 0.1, 0.5], 3)
    t_ns = stamps(n, every_s=0.02)
    error = factor * sigma * rng.standard_normal((n, 9))
    half = 0.5 * error[:, :3]
    q_nb = np.column_stack([np.ones(n), half]) / np.sqrt(1.0 + (half**2).sum(axis=1))[:, None]
    metre_deg = math.degrees(1.0 / 6378137.0)
    lla = np.array([0.0, 8.0, 400.0]) + error[:, 6:] * [metre_deg * 1.0067395, metre_deg, -1.0]  # on the equator
    own = lane("ins_ekf", t_ns, q_nb, error[:, 3:6], lla, sigma)
    truth = lane("reference", t_ns, [1.0, 0.0, 0.0, 0.0], 0.0, [0.0, 8.0, 400.0], math.nan)
    return own, truth


@pytest.mark.parametrize(
    ("factor", "word"), [(1.0, "consistent"), (2.0, "over-confident"), (0.5, "conservative")], ids=str
)
def test_state_errors_are_judged_against_the_published_sigma(factor, word):
    own, truth = flight(np.random.default_rng(4), 4000, factor)
    book = NeesBook("ins_ekf")
    book.add((own, truth))
    tests = dict(book.tests())
    assert {name: test.verdict for name, test in tests.items()} == dict.fromkeys(tests, word)
    assert set(tests) == {"attitude", "velocity", "position"}


def test_a_reference_that_comes_late_in_pieces_of_its_own_gives_the_same():
    own, truth = flight(np.random.default_rng(4), 3000)
    whole, pieces = NeesBook("ins_ekf"), NeesBook("ins_ekf")
    whole.add((own, truth))
    for at in range(0, 3200, 50):
        part, late = slice(at, at + 50), slice(max(0, at - 100), max(0, at - 50))
        pieces.add((LaneRows(lane="ins_ekf", t_ns=own.t_ns[part], data=own.data[part]),))
        pieces.add((LaneRows(lane="reference", t_ns=truth.t_ns[late], data=truth.data[late]),))
    assert pieces.tests()[0][1].samples == whole.tests()[0][1].samples
    assert [t.mean for _, t in pieces.tests()] == pytest.approx([t.mean for _, t in whole.tests()])


def test_a_reference_of_height_and_attitude_alone_is_no_reference_for_position():
    own, truth = flight(np.random.default_rng(4), 3000)
    truth.data[:, 7] = math.nan
    book = NeesBook("ins_ekf")
    book.add((own, truth))
    assert {name: test.samples > 0 for name, test in book.tests()} == {
        "attitude": True,
        "velocity": True,
        "position": False,
    }


def test_errors_are_true_minus_estimated_in_north_east_down():
    angle = 0.02
    q_true = np.array([[math.cos(angle / 2), 0.0, 0.0, -math.sin(angle / 2)]])
    np.testing.assert_allclose(rotation_errors(np.array([[-1.0, 0.0, 0.0, 0.0]]), q_true), [[0.0, 0.0, -angle]])
    here, there = np.array([[47.0, 8.0, 400.0]]), np.array([[47.001, 8.001, 398.0]])
    np.testing.assert_allclose(place_errors(here, there), [[111.184, 76.063, 2.0]], rtol=1e-3)


def test_a_lane_without_sigma_gives_no_components():
    own, truth = flight(np.random.default_rng(4), 10)
    own.data[:, 10:19] = math.nan
    assert all(np.isnan(part).all() for part in normalised_errors(own.data, truth.data))


def test_the_lane_is_as_good_as_the_worst_of_its_groups():
    rng = np.random.default_rng(9)
    book = AidBook()
    book.add(aid_rows(Aid.GNSS_VELOCITY, white(rng, 280), 1.0))
    book.add(aid_rows(Aid.BARO_HEIGHT, white(rng, 280, 2.0), 1.0))
    book.add(aid_rows(Aid.ZERO_VELOCITY, white(rng, 280, 0.01), 1.0))
    (whole,) = consistency(book, NeesBook("ins_ekf"))
    assert (whole.group, whole.verdict) == ("lane", "over-confident")
    assert whole.reason.startswith("baro_height NIS")
    health = {entry.aid: entry for entry in book.health()}
    assert health[Aid.GNSS_VELOCITY].verdict == "consistent"
    assert health[Aid.ZERO_VELOCITY].verdict == "conservative"
    low, mean, high = (getattr(health[Aid.GNSS_VELOCITY], name) for name in ("nis_low", "nis_mean", "nis_high"))
    assert low < mean < high


def test_many_consistent_groups_rarely_make_an_inconsistent_lane():
    rng = np.random.default_rng(10)
    told = []
    for _ in range(200):
        groups = []
        for name in "abcdefg":
            window = Window()
            window.add(stamps(200), white(rng, 200))
            groups.append((name, window.test()))
        told.append(lane_verdict("ins_ekf", groups).verdict)
    assert told.count("consistent") / len(told) >= 0.90


def test_before_the_first_sample_nothing_is_known():
    book = AidBook()
    (whole,) = consistency(book, NeesBook("ins_ekf"))
    assert whole.verdict == "too-few"
    entry = AidHealth(aid=Aid.GRAVITY, fused=0, refused=(), t_fused_ns=-1, last=())
    assert (entry.verdict, entry.nis_samples) == ("too-few", 0)
