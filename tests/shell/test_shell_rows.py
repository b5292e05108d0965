"""Rows: their layout, thinning, and the history of the last minutes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.history import RATE_HZ, History, Ring
from server.nav.types import AID_COLUMNS
from server.rows import HEADER, Table, Thinner, joined, message, packed, row_topics
from tests.shell.shell_fakes import SAMPLE_NS, SAMPLES_PER_STEP, FakeEngine, FakeProtocol

SECOND_NS = 1_000_000_000


def table_of(t_ns: list[int]) -> Table:
    stamps = np.array(t_ns, dtype=np.int64)
    return Table(stamps, stamps[:, None] / 10.0)


stamps = st.lists(st.integers(1, 10**8), min_size=1, max_size=200).map(lambda steps: list(np.cumsum(steps)))


@given(stamps, st.data())
def test_thinning_keeps_one_row_a_period_however_the_rows_are_cut(t_ns: list[int], data: st.DataObject) -> None:
    rate_hz = 20.0
    thinner, start, kept = Thinner(rate_hz), 0, []
    while start < len(t_ns):
        end = data.draw(st.integers(start + 1, len(t_ns)))
        part = thinner.thin(table_of(t_ns[start:end]))
        kept += [] if part is None else part.t_ns.tolist()
        start = end
    period_ns = SECOND_NS / rate_hz
    slots = [stamp // period_ns for stamp in kept]
    assert sorted(set(slots)) == slots
    assert set(slots) == {stamp // period_ns for stamp in t_ns}


def test_rows_of_different_groups_do_not_replace_each_other() -> None:
    table = Table(np.array([1, 2, 3, 4]), np.array([[0.0, 1], [1, 2], [0, 3], [1, 4]]))
    kept = Thinner(1.0).thin(table, 0)
    assert kept is not None
    np.testing.assert_array_equal(kept.data, [[0, 3], [1, 4]])


def test_a_message_is_its_header_and_little_endian_doubles() -> None:
    table = Table(np.array([2**53 - 1], dtype=np.int64), np.array([[1.5, np.nan]]))
    raw = message(9, 65_536 + 5, 1, 2, packed(table))
    assert HEADER.unpack(raw[:8]) == (1, 9, 1, 2, 5)
    values = np.frombuffer(raw, "<f8", offset=8)
    assert values[0] == 2**53 - 1  # exact in a JavaScript number
    np.testing.assert_array_equal(values[1:], [1.5, np.nan])


def test_joining_nothing_is_nothing() -> None:
    assert joined([None, None]) is None


@given(st.integers(1, 9), st.lists(st.integers(1, 12), max_size=12))
def test_a_ring_holds_exactly_the_newest_rows(capacity: int, sizes: list[int]) -> None:
    ring, everything = Ring(capacity, 1), []
    for size in sizes:
        part = list(range(len(everything) + 1, len(everything) + size + 1))
        ring.append(table_of(part))
        everything += part
    held = ring.since(0)
    assert held.t_ns.tolist() == everything[-capacity:]
    np.testing.assert_array_equal(held.data[:, 0], held.t_ns / 10.0)


def filled_history(samples: int, *, reboot: bool = False) -> History:
    history, protocol, engine = History(row_topics(("ins_ekf",)), span_s=10.0), FakeProtocol(None), FakeEngine()
    for data in [bytes(samples)] if not reboot else [bytes(samples), b"\xff" + bytes(samples // 2)]:
        for block in protocol.feed(data, 0).blocks:
            history.add(engine.step(block))
    return history


def test_history_keeps_its_span_at_its_rate() -> None:
    history = filled_history(20 * 500)
    table = history.rows("lanes/ins_ekf", 1000.0)
    assert table.t_ns.size == 10.0 * RATE_HZ
    assert table.t_ns[-1] == 20 * SECOND_NS
    assert history.rows("lanes/ins_ekf", 2.0).t_ns[0] >= 18 * SECOND_NS


def test_history_keeps_each_kind_of_aid() -> None:
    aids = filled_history(10 * 500).rows("aids", 5.0)
    assert aids.data.shape[1] == len(AID_COLUMNS)
    assert len(set(aids.data[:, 0])) > 100  # the fake engine numbers its aids by step: none replaced another


def test_a_reboot_forgets_the_power_up_before() -> None:
    table = filled_history(1000, reboot=True).rows("raw/imu", 1000.0)
    assert table.t_ns[-1] == 500 * SAMPLE_NS
    assert table.t_ns.max() == table.t_ns[-1]


def test_the_native_rate_is_measured_from_the_stamps() -> None:
    history, protocol, engine = History(row_topics(("ins_ekf",)), 10.0), FakeProtocol(None), FakeEngine()
    assert history.native_rate_hz("raw/imu") is None
    for _ in range(3):
        for block in protocol.feed(bytes(500), 0).blocks:
            history.add(engine.step(block))
        history.flush()
    assert history.native_rate_hz("raw/imu") == SECOND_NS / SAMPLE_NS
    assert history.native_rate_hz("lanes/ins_ekf") == SECOND_NS / SAMPLE_NS / SAMPLES_PER_STEP
