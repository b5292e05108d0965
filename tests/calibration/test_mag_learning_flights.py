"""Learning the magnetic offset on the demo board's flight: turns of 90° about the vertical, and small tilts."""

from pathlib import Path

import numpy as np
import pytest

from server.nav.calibration.in_flight import MagInFlight
from server.nav.calibration.mag_learning import MagLearner
from server.nav.calibration.types import Options
from server.nav.preprocess.check import decade_scale
from server.nav.types import Kind
from server.replay.source import load
from server.sim import SimSettings
from server.simulator import Magnet, RoomMagnet
from tests.calibration.mag_learning_flights import LearningFlight
from tests.calibration.mag_learning_simulation import World, learn, simulate

STANDS_S = 14.0  # it takes off after that
CIRCUIT_S = 78.0  # and the square of four turns is flown by then
PUT_ON_S = 60.0  # after three of them
HARD_IRON = (0.012, -0.012, 0.010)  # 20 mG
MISSION_PUT_ON_S = 75.0


@pytest.mark.parametrize(("seed", "wind_m_s"), [(1, 4.0), (2, 0.0), (3, 10.0), (4, 4.0)])
def test_a_good_compass_is_known_by_the_end_of_the_first_circuit(seed, wind_m_s):
    flight = LearningFlight(110.0, SimSettings(seed=seed, wind_m_s=wind_m_s))
    known = flight.at(CIRCUIT_S)
    assert known.converged
    assert not flight.share(STANDS_S, 110.0, lambda state: state.reason == "room")
    for t_s in (40.0, 60.0, CIRCUIT_S, 110.0):
        state = flight.at(t_s)
        assert (np.abs(state.offset_gauss - flight.truth_gauss) < 3.0 * state.sigma_gauss).all()
    assert state.sigma_gauss.max() < 0.006
    assert np.abs(state.offset_gauss - flight.truth_gauss).max() < 0.004
    assert state.residual_gauss < 0.003  # the sensor's noise is 1.5 mG, and nothing else is uneven


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_board_that_stands_learns_nothing_however_wrong_its_gyro_is(seed):
    flight = LearningFlight(STANDS_S, SimSettings(seed=seed, errors="raw"))
    np.testing.assert_array_equal(flight.offsets(0.0, STANDS_S), 0.0)
    assert flight.at(STANDS_S).reason == "rest"
    np.testing.assert_array_equal(flight.at(STANDS_S).excitation, 0.0)


@pytest.mark.parametrize(
    ("field_b", "seed"),
    [
        ((0.05, -0.03, 0.06), 1),
        ((0.05, -0.03, 0.06), 3),
        ((0.0, 0.05, 0.0), 2),
        ((0.02, 0.0, 0.0), 4),
        ((0.2, 0.0, 0.0), 4),
        ((0.0, 0.0, -0.06), 1),
        ((0.0, 0.0, 0.2), 2),
    ],
)
def test_a_magnet_put_on_in_flight_is_followed_within_40_s(field_b, seed):
    flight = LearningFlight(
        PUT_ON_S + 50.0, SimSettings(seed=seed), [(PUT_ON_S, Magnet(is_on=True, field_b_gauss=field_b))]
    )
    for t_s in (PUT_ON_S + 40.0, PUT_ON_S + 50.0):
        state = flight.at(t_s)
        error = state.offset_gauss - flight.truth_gauss - field_b
        assert np.abs(error).max() < 0.008
        assert (np.abs(error) < 3.0 * state.sigma_gauss).all()
        assert state.converged
        assert not state.frozen or state.reason == "rest"


@pytest.mark.parametrize(
    ("field_b", "seed"), [((0.05, -0.03, 0.06), 1), ((-0.03, 0.05, 0.26), 2), ((0.15, 0.1, -0.05), 3)]
)
def test_a_magnet_taken_off_shortly_before_the_landing_is_noticed_and_unlearned_in_the_next_flight(field_b, seed):
    orders = [(50.0, Magnet(is_on=True, field_b_gauss=field_b)), (95.0, Magnet(is_on=False))]
    flight = LearningFlight(185.0, SimSettings(seed=seed, wind_m_s=6.0), orders)
    assert np.abs(flight.at(94.0).offset_gauss - flight.truth_gauss - field_b).max() < 0.008
    assert not flight.at(105.0).converged
    state = flight.states[-1]  # 35 s after the take-off
    assert np.abs(state.offset_gauss - flight.truth_gauss).max() < 0.008
    assert state.converged
    assert state.changes > 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_iron_of_the_room_is_not_taken_for_the_boards(seed):
    flight = LearningFlight(PUT_ON_S + 50.0, SimSettings(seed=seed), [(PUT_ON_S, RoomMagnet(is_on=True))])
    before = flight.at(PUT_ON_S).offset_gauss
    assert np.abs(flight.offsets(PUT_ON_S, PUT_ON_S + 50.0) - before).max() < 0.008
    assert flight.share(PUT_ON_S, PUT_ON_S + 15.0, lambda state: state.reason == "room") > 0.3
    assert flight.states[-1].converged  # one that stays is another place, no reason to doubt the offset
    assert flight.states[-1].changes == 0


@pytest.mark.parametrize("size", [0.1, 0.3])
def test_a_field_of_the_room_that_sweeps_freezes_it(size):
    times = np.arange(PUT_ON_S, PUT_ON_S + 50.0, 0.5)
    angle = times - PUT_ON_S
    fields = size * np.stack([np.sin(0.5 * angle), np.cos(0.35 * angle), 0.7 * np.sin(0.8 * angle)], axis=1)
    orders = [
        (t, RoomMagnet(is_on=True, field_n_gauss=tuple(f)))
        for t, f in zip(times.tolist(), fields.tolist(), strict=True)
    ]
    flight = LearningFlight(PUT_ON_S + 50.0, SimSettings(seed=2), orders)
    before = flight.at(PUT_ON_S).offset_gauss
    assert np.abs(flight.offsets(PUT_ON_S, PUT_ON_S + 50.0) - before).max() < 0.008
    assert flight.share(PUT_ON_S + 5.0, PUT_ON_S + 50.0, lambda state: state.reason in {"room", "rest"}) > 0.95
    assert not flight.share(PUT_ON_S + 5.0, PUT_ON_S + 50.0, lambda state: state.converged)


@pytest.mark.parametrize("seed", range(3))
def test_turning_about_the_vertical_alone_follows_what_it_shows_of_a_magnet_and_says_what_it_does_not(seed):
    magnet = np.array([0.05, -0.03, 0.06])
    world = World(
        seed=seed,
        one_axis=True,
        duration_s=120.0,
        attached=lambda t_s: np.where(t_s[:, None] > 60.0, 1.0, 0.0) * magnet,
    )
    state = learn(MagLearner(offset_gauss=world.offset, sigma_gauss=0.01), *simulate(world))[-1]
    error = state.offset_gauss - world.offset - magnet
    assert np.abs(error[:2]).max() < 0.008
    assert state.sigma_gauss[:2].max() < 0.015
    assert state.sigma_gauss[2] > 0.03
    assert abs(error[2]) < 3.0 * state.sigma_gauss[2]
    assert not state.converged
    assert not state.frozen


def test_it_agrees_with_the_navigation_filters_magnetic_bias():
    orders = [(0.0, Magnet(is_on=True, field_b_gauss=HARD_IRON))]
    flight = LearningFlight(110.0, SimSettings(seed=1), orders, lanes=("ins_ekf",))
    bias, state = flight.engine.snapshot().mag_bias, flight.states[-1]
    theirs, sigma = np.array(bias[:3]), np.array(bias[3:])
    assert (np.abs(state.offset_gauss - theirs) < 3.0 * np.hypot(state.sigma_gauss, sigma)).all()
    for one in (theirs, state.offset_gauss):
        np.testing.assert_allclose(one, flight.truth_gauss + HARD_IRON, atol=0.006)


@pytest.fixture(scope="module")
def mission(shared_data: Path):
    """Stamps and rows by kind of an ArduPilot simulation's log, the field in gauss, in blocks of order of arrival."""
    blocks, scale = [], 0.0
    for block in load(shared_data / "ardupilot_sitl" / "mission.tlog").blocks(4096):
        for kind in (Kind.IMU, Kind.MAG):
            rows, t_ns = block.data[block.kind == kind].copy(), block.t_ns[block.kind == kind]
            if kind is Kind.MAG and len(rows):
                scale = scale or decade_scale(float(np.linalg.norm(rows[0, :3])))
                rows[:, :3] *= scale
            blocks.append((kind, t_ns, rows))
    return blocks


def learned(blocks, offset, from_s):
    """Return the state after the blocks, with an offset on the field from some time after the first sample on."""
    collector, begin_ns = MagInFlight(Options()), int(blocks[0][1][0])
    for kind, t_ns, rows in blocks:
        changed = rows.copy()
        if kind is Kind.MAG:
            changed[t_ns > begin_ns + from_s * 1e9, :3] += offset
        collector.feed(kind, t_ns, changed)
    return collector.state()


@pytest.mark.parametrize("offset", [(0.01, 0.0, 0.0), (0.03, -0.02, 0.02), (-0.05, 0.08, 0.03), (0.0, 0.0, 0.1)])
def test_an_offset_added_in_the_middle_of_a_mission_is_found(mission, offset):
    bare, state = learned(mission, 0.0, 0.0), learned(mission, offset, MISSION_PUT_ON_S)
    error = state.offset_gauss - bare.offset_gauss - offset
    assert (np.abs(error) < 3.0 * np.hypot(state.sigma_gauss, bare.sigma_gauss)).all()
    assert np.abs(error).max() < 0.015
    assert state.reason != "room"
