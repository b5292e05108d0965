"""A receiver that lies for a while, one that is right in the end, and inertial sensors that stop or talk nonsense."""

import functools
import math
from pathlib import Path

import numpy as np
import pytest

from server.nav.types import Aid, AidStatus, Kind, SampleBlock

from .ekf_flights import Floats, rest, s_turns, stream_of
from .ekf_flown import Flown, fly
from .ekf_mission import METRES_PER_DEG, apart_m, changed, fly_mission, mission, only

KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
JUMP_M, SPEED_M_S = 50.0, 10.0
BEGINS_S = [90.0, 120.0]
TURNS = s_turns()


@functools.cache
def clean(shared_data: Path) -> tuple[SampleBlock, Flown]:
    """Return the flight and what becomes of it undisturbed."""
    block = mission(shared_data)
    return block, fly_mission(block)


def jumped(rows: Floats) -> None:
    rows[:, 0] += JUMP_M / METRES_PER_DEG


def hurried(rows: Floats) -> None:
    rows[:, 3] += SPEED_M_S


def glitched(shared_data: Path, change, begin_s: float, length_s: float) -> tuple[Flown, Flown]:
    """Return the flight with GNSS changed for a while, and the undisturbed one."""
    block, undisturbed = clean(shared_data)
    return fly_mission(changed(block, Kind.GNSS, change, begin_s, begin_s + length_s)), undisturbed


@pytest.mark.parametrize("begin_s", BEGINS_S)
def test_a_jump_of_fifty_metres_moves_nothing(shared_data: Path, begin_s: float) -> None:
    flown, undisturbed = glitched(shared_data, jumped, begin_s, 5.0)
    statuses = flown.statuses(Aid.GNSS_POSITION, begin_s, begin_s + 3.0)
    assert set(statuses) == {AidStatus.REFUSED_GATE}
    assert np.nanmax(apart_m(flown, undisturbed)[flown.t_s > begin_s]) < 0.5
    assert set(flown.statuses(Aid.GNSS_VELOCITY, begin_s, begin_s + 5.0)) == {AidStatus.FUSED}


@pytest.mark.parametrize("begin_s", BEGINS_S)
def test_it_is_not_believed_while_it_lasts(shared_data: Path, begin_s: float) -> None:
    flown, _ = glitched(shared_data, jumped, begin_s, 5.0)
    assert set(flown.statuses(Aid.GNSS_POSITION, begin_s, begin_s + 4.85)) == {AidStatus.REFUSED_GATE}
    (back,) = [event for event in flown.events if event.code == "gnss-back"]
    assert dict(back.values)["horizontal_m"] < 0.5


@pytest.mark.parametrize("begin_s", BEGINS_S)
def test_a_jump_that_stays_is_taken_with_its_size(shared_data: Path, begin_s: float) -> None:
    """Ten seconds of fixes that agree with each other and not with the filter: then the receiver is right."""
    flown, undisturbed = glitched(shared_data, jumped, begin_s, 30.0)
    event = next(event for event in flown.events if event.code == "gnss-reset")
    assert begin_s + 10.0 < event.t_ns * 1e-9 < begin_s + 12.0
    assert dict(event.values)["horizontal_m"] == pytest.approx(JUMP_M, abs=1.0)
    refused_s = flown.between(begin_s, begin_s + 10.0)
    assert np.nanmax(apart_m(flown, undisturbed)[refused_s]) < 0.5
    taken = flown.between(begin_s + 13.0, begin_s + 29.0)
    assert np.abs(apart_m(flown, undisturbed)[taken] - JUMP_M).max() < 1.0


@pytest.mark.parametrize("begin_s", BEGINS_S)
@pytest.mark.parametrize("length_s", [5.0, 30.0])
def test_a_velocity_that_its_own_positions_contradict_is_refused(
    shared_data: Path, begin_s: float, length_s: float
) -> None:
    flown, undisturbed = glitched(shared_data, hurried, begin_s, length_s)
    statuses = flown.statuses(Aid.GNSS_VELOCITY, begin_s, begin_s + length_s - 0.15)
    assert set(statuses) == {AidStatus.REFUSED_GATE}
    assert set(flown.statuses(Aid.GNSS_POSITION, begin_s, begin_s + length_s)) == {AidStatus.FUSED}
    assert np.nanmax(apart_m(flown, undisturbed)[flown.t_s > begin_s]) < 0.1
    assert (flown.statuses(Aid.GNSS_VELOCITY, begin_s + length_s + 5.0) == AidStatus.FUSED).all()


def test_refusals_carry_their_reason_and_their_ratio(shared_data: Path) -> None:
    flown, _ = glitched(shared_data, jumped, 90.0, 5.0)
    refused = flown.aids[(flown.aids[:, 1] == AidStatus.REFUSED_GATE) & (flown.aids[:, 0] == Aid.GNSS_POSITION)]
    assert (refused[:, 14] > 1.0).all()
    assert refused[0, 8] == pytest.approx(JUMP_M, abs=0.5)  # the innovation north is the jump


# ---- the inertial sensor itself ----


def imu_changed(block: SampleBlock, start_s: float, end_s: float, change) -> SampleBlock:
    return changed(block, Kind.IMU, change, start_s, end_s)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e6])
@pytest.mark.parametrize("column", [0, 2, 3, 5])
def test_numbers_that_no_sensor_has_harm_nothing(bad: float, column: int) -> None:
    """A step's worth of samples in a turn, 20 ms: bridged, and no number of them in the state."""
    block = stream_of(TURNS).block()
    undisturbed = fly(block, **KNOWN)

    def spoil(rows: Floats) -> None:
        rows[:, column] = bad

    flown = fly(imu_changed(block, 50.0, 50.02, spoil), **KNOWN)
    assert "filter-failed" not in flown.codes()
    assert np.isfinite(flown.rows[flown.t_s > 20.0][:, :25]).all()
    both, mine, other = np.intersect1d(flown.t_s, undisturbed.t_s, return_indices=True)
    assert len(both) >= len(undisturbed.t_s) - 1
    apart = np.abs(flown.rows[mine] - undisturbed.rows[other])[both > 20.0]
    assert apart[:, 26:28].max() < 0.05
    assert apart[:, :4].max() < math.radians(0.1)


def test_a_short_hole_is_bridged_and_a_long_one_is_said() -> None:
    block = stream_of(TURNS).block()
    t_s = block.t_ns * 1e-9
    for length_s, codes in ((0.2, []), (2.0, ["imu-gap", "aligned"])):
        hole = (block.kind == Kind.IMU) & (t_s > 50.0) & (t_s < 50.0 + length_s)
        flown = fly(only(block, ~hole), **KNOWN)
        assert [code for code in flown.codes() if code in {"imu-gap", "aligned"}][1:] == codes
        assert np.isfinite(flown.rows[-1, :25]).all()
        assert flown.rows[-1, 25] == 2
        late = flown.t_s > 80.0
        position = np.array([TURNS.at(flown.t_s[late], TURNS.pos_n)[:, i] for i in (0, 1)]).T
        assert np.linalg.norm(flown.rows[late, 26:28] - position, axis=1).max() < 1.0


def test_a_sensor_that_freezes_is_counted_and_the_lane_stops_saying() -> None:
    """Frozen numbers are no data: no row is made of them, and the hole is reported when it lives again."""
    block = stream_of(TURNS).block()

    def freeze(rows: Floats) -> None:
        rows[:] = rows[0]

    flown = fly(imu_changed(block, 50.0, 53.0, freeze), **KNOWN)
    assert not flown.between(50.8, 53.0).any()
    assert "imu-gap" in flown.codes()
    imu = next(sensor for sensor in flown.engine.snapshot().sensors if sensor.name == "imu")
    assert dict(imu.refused)["stuck"] > 400
    assert flown.rows[-1, 25] == 2


def test_samples_that_come_twice_or_in_the_wrong_order_change_nothing() -> None:
    """A link that repeats and swaps: stamps decide, and what is older than the last is counted and left out."""
    block = stream_of(rest(30.0)).block()
    t_s = block.t_ns * 1e-9
    order = np.arange(len(t_s))
    imu = np.flatnonzero((block.kind == Kind.IMU) & (t_s > 12.0))
    repeated = np.insert(order, imu[::50] + 1, imu[::50])
    late = np.insert(order, imu[100::50] + 1, imu[:-100:50])
    undisturbed = fly(block, **KNOWN)
    for rows in (repeated, late):
        twice = SampleBlock(
            kind=block.kind[rows], t_ns=block.t_ns[rows], t_rx_ns=block.t_rx_ns[rows], data=block.data[rows]
        )
        flown = fly(twice, **KNOWN)
        np.testing.assert_array_equal(flown.rows, undisturbed.rows)
