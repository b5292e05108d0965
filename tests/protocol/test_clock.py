"""Board clock against host clock: the lower envelope of the recorded arrivals, and known truths with stalls in them."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from server.protocol.mavlink import MavlinkProtocol
from server.protocol.mavlink.clock import MIN_BUCKETS, ClockEstimator, fit_lower_line
from tests.protocol.peer import Writer, records

MINUTE_NS = 60 * 10**9


def envelope(t_ns: np.ndarray, offset_ns: np.ndarray) -> tuple[float, float, float]:
    """The highest line under all points by linear programming: (t0, offset at t0, slope)."""
    t, d = (t_ns - t_ns[0]) * 1e-9, (offset_ns - offset_ns[0]) * 1e-9
    answer = linprog(-np.array([1.0, t.mean()]), np.column_stack([np.ones_like(t), t]), d, bounds=[(None, None)] * 2)
    return float(t_ns[0]), float(answer.x[0] * 1e9 + offset_ns[0]), float(answer.x[1])


@pytest.mark.parametrize("name", ["mission.tlog", "static.tlog"])
def test_drift_and_offset_of_a_recorded_session_equal_the_envelope_of_all_its_stamps(
    shared_data: Path, name: str
) -> None:
    clock = ClockEstimator()
    stamps, arrivals = [], []
    for stamp_us, frame in records(shared_data / "ardupilot_sitl" / name):
        if int.from_bytes(frame[7:10], "little") == 105:
            stamps.append(int.from_bytes(frame[10:18], "little") * 1000)
            arrivals.append(stamp_us * 1000)
            clock.add(stamps[-1], arrivals[-1])
    t_ns, offset_ns = np.array(stamps), np.array(arrivals) - np.array(stamps)
    at, offset, slope = envelope(t_ns, offset_ns)
    found_offset, found_ppm = clock.estimate()
    assert 100 < slope * 1e6 < 600  # what the index of the recordings says of them
    assert found_ppm == pytest.approx(slope * 1e6, abs=8.0)
    assert found_offset == pytest.approx(offset + slope * (stamps[-1] - at), abs=1.5e6)


def arrivals(t_ns: np.ndarray, ppm: float, seed: int) -> np.ndarray:
    """A perfect clock with a drift, 2 ms of transport at least, jitter, and a stall of half a second every 20 s."""
    generator = np.random.default_rng(seed)
    delay = 2e6 + generator.exponential(1.5e6, len(t_ns))
    phase = (t_ns * 1e-9) % 20
    delay += np.where(phase < 0.5, (0.5 - phase) * 1e9, 0.0)
    return (5_000_000_000_000 + t_ns * (1 + ppm * 1e-6) + delay).astype(np.int64)


@pytest.mark.parametrize("ppm", [-300.0, 0.0, 45.0, 460.0])
def test_a_known_drift_is_found_through_jitter_and_stalls(ppm: float) -> None:
    t_ns = np.arange(0, 4 * MINUTE_NS, 3_000_000)
    clock = ClockEstimator()
    for stamp, arrival in zip(t_ns.tolist(), arrivals(t_ns, ppm, 1).tolist(), strict=True):
        clock.add(stamp, arrival)
    offset, found = clock.estimate()
    assert found == pytest.approx(ppm, abs=1.0)
    truth = 5_000_000_000_000 + t_ns[-1] * ppm * 1e-6 + 2e6
    assert offset == pytest.approx(truth, abs=0.2e6)


def test_one_stamp_from_the_future_does_not_bend_the_line() -> None:
    t_ns = np.arange(0, 2 * MINUTE_NS, 3_000_000)
    arrived = arrivals(t_ns, 250.0, 2)
    arrived[20_000] -= 900_000_000
    clock = ClockEstimator()
    for stamp, arrival in zip(t_ns.tolist(), arrived.tolist(), strict=True):
        clock.add(stamp, arrival)
    offset, found = clock.estimate()
    assert found == pytest.approx(250.0, abs=2.0)
    assert offset == pytest.approx(5_000_000_000_000 + t_ns[-1] * 250e-6 + 2e6, abs=0.3e6)


def test_a_long_stall_at_the_end_does_not_bend_the_line() -> None:
    t_ns = np.arange(0, 2 * MINUTE_NS, 3_000_000)
    arrived = arrivals(t_ns, 250.0, 3)
    arrived[-3000:] += np.linspace(0, 4e9, 3000).astype(np.int64)
    clock = ClockEstimator()
    for stamp, arrival in zip(t_ns.tolist(), arrived.tolist(), strict=True):
        clock.add(stamp, arrival)
    assert clock.estimate()[1] == pytest.approx(250.0, abs=3.0)


def test_the_line_lies_under_all_points_it_keeps() -> None:
    generator = np.random.default_rng(4)
    t_ns = np.cumsum(generator.integers(500_000_000, 1_500_000_000, 100))
    offset_ns = (1e6 * generator.exponential(1.0, 100) + t_ns * 2e-4).astype(np.int64)
    at, offset, slope = fit_lower_line(t_ns, offset_ns)
    assert (offset_ns - (offset + slope * (t_ns - at)) > -1e-3).all()
    _, low, low_slope = envelope(t_ns, offset_ns)
    assert slope == pytest.approx(low_slope, rel=1e-6)
    assert offset + slope * (t_ns[0] - at) == pytest.approx(low, abs=1.0)


def test_drift_is_unknown_at_first_and_the_offset_is_the_least() -> None:
    clock = ClockEstimator()
    assert all(math.isnan(value) for value in clock.estimate())
    for k, late in enumerate((5, 2, 9)):
        clock.add(1000 * k, 1000 * k + 10**12 + late)
    offset, ppm = clock.estimate()
    assert offset == 10**12 + 2
    assert math.isnan(ppm)
    assert MIN_BUCKETS >= 5


def test_an_answered_time_sync_takes_the_transport_out_of_the_offset() -> None:
    clock = ClockEstimator()
    for second in range(30):
        t_ns = second * 10**9
        clock.add(t_ns, t_ns + 10**12 + 8_000_000)  # 8 ms of transport that no minimum shows
    assert clock.estimate()[0] == pytest.approx(10**12 + 8e6, abs=1.0)
    board_ns = 29 * 10**9
    clock.add_sync(board_ns + 10**12 - 4_000_000, board_ns + 10**12 + 4_000_000, board_ns)
    clock.add_sync(board_ns + 10**12 - 90_000_000, board_ns + 10**12 + 9_000_000, board_ns)  # slow one way: not used
    clock.add_sync(board_ns, board_ns + 10**12, board_ns)  # absurd
    assert clock.estimate()[0] == pytest.approx(10**12, abs=1.0)


def test_the_protocol_keeps_time_with_the_board_and_forgets_it_at_a_reboot() -> None:
    writer, protocol = Writer(), MavlinkProtocol()
    protocol.feed(writer("HEARTBEAT", type=2, autopilot=3), 0)
    host_ns = 10**12
    for k in range(2000):
        protocol.feed(writer("ATTITUDE_QUATERNION", time_boot_ms=60_000 + 10 * k, q1=1.0), host_ns + 10_002_000 * k)
    stats = protocol.stats
    assert stats.clock_drift_ppm == pytest.approx(200.0, abs=0.1)
    assert stats.clock_offset_ns == pytest.approx(host_ns - 60e9 + 2000 * 1999, abs=10.0)
    for k in range(5):
        protocol.feed(writer("ATTITUDE_QUATERNION", time_boot_ms=100 + 10 * k, q1=1.0), 2 * 10**12 + 10_000_000 * k)
    stats = protocol.stats
    assert math.isnan(stats.clock_drift_ppm)
    assert stats.clock_offset_ns == pytest.approx(2 * 10**12 - 0.1e9, abs=1.0)


def test_time_sync_runs_over_the_wire() -> None:
    writer, protocol = Writer(), MavlinkProtocol()
    protocol.feed(
        writer("HEARTBEAT", type=2, autopilot=3) + writer("ATTITUDE_QUATERNION", time_boot_ms=60_000, q1=1.0), 0
    )
    sent_ns = 3 * 10**9
    protocol.outgoing(sent_ns)
    answer = writer("TIMESYNC", tc1=60_000_000_000, ts1=sent_ns)
    other = writer("TIMESYNC", tc1=1, ts1=12345)  # somebody else's
    protocol.feed(answer + other, sent_ns + 6_000_000)
    protocol.feed(writer("ATTITUDE_QUATERNION", time_boot_ms=60_000, q1=1.0), sent_ns + 9_000_000)
    assert protocol.stats.clock_offset_ns == pytest.approx(sent_ns + 3e6 - 60e9, abs=1.0)
