"""Rows: their layout, thinning, and the history of the last minutes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.history import RATE_HZ, History, Ring
from server.nav.lanes.passthrough import repeat
from server.nav.types import (
    AID_COLUMNS,
    ROW_WIDTH,
    STEP_COLUMNS,
    AidRows,
    FilteredRows,
    Kind,
    SampleBlock,
    StepResult,
)
from server.rows import HEADER, Table, Thinner, known_columns, message, packed, row_topics
from tests.shell.shell_fakes import SAMPLE_NS, SAMPLES_PER_STEP, FakeEngine, FakeProtocol

SECOND_NS = 1_000_000_000


def table_of(t_ns: list[int]) -> Table:
    stamps = np.array(t_ns, dtype=np.int64)
    return Table(stamps, stamps[:, None] / 10.0)


stamps = st.lists(st.integers(1, 10**8), min_size=1, max_size=200).map(lambda steps: list(np.cumsum(steps)))


@given(stamps, st.data())
def test_thinning_keeps_the_first_row_of_each_period_however_the_rows_are_cut(
    t_ns: list[int], data: st.DataObject
) -> None:
    rate_hz = 20.0
    thinner, start, kept = Thinner(rate_hz), 0, []
    while start < len(t_ns):
        end = data.draw(st.integers(start + 1, len(t_ns)))
        part = thinner.thin(table_of(t_ns[start:end]))
        kept += [] if part is None else part.t_ns.tolist()
        start = end
    firsts: dict[int, int] = {}
    for stamp in t_ns:
        firsts.setdefault(stamp // (SECOND_NS // 20), stamp)
    assert kept == list(firsts.values())


def test_rows_of_different_groups_do_not_replace_each_other() -> None:
    table = Table(np.array([1, 2, 3, 4]), np.array([[0.0, 1], [1, 2], [0, 3], [1, 4]]))
    kept = Thinner(1.0, lambda data: data[:, 0]).thin(table)
    assert kept is not None
    np.testing.assert_array_equal(kept.data, [[0, 1], [1, 2]])


def test_a_message_is_its_header_and_little_endian_doubles() -> None:
    table = Table(np.array([2**53 - 1], dtype=np.int64), np.array([[1.5, np.nan]]))
    raw = message(9, 65_536 + 5, 1, 2, packed(table))
    assert HEADER.unpack(raw[:8]) == (1, 9, 1, 2, 5)
    values = np.frombuffer(raw, "<f8", offset=8)
    assert values[0] == 2**53 - 1  # exact in a JavaScript number
    np.testing.assert_array_equal(values[1:], [1.5, np.nan])


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


ATTITUDE: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
PLACE: tuple[float, ...] = (math.nan,) * 4 + (-35.36, 149.16, 584.0, 5.0, 0.0, 0.0)


def reported(attitude_hz: int, place_hz: int, span_s: int) -> SampleBlock:
    """What a board says of itself: attitudes and places, each at its own stamps, in the order of these."""
    stamps = [(SECOND_NS * i // attitude_hz, ATTITUDE) for i in range(attitude_hz * span_s)]
    stamps += [(SECOND_NS * i // place_hz + 5_000_000, PLACE) for i in range(place_hz * span_s)]
    stamps.sort(key=lambda row: row[0])
    data = np.full((len(stamps), ROW_WIDTH), np.nan)
    for row, (_, values) in zip(data, stamps, strict=True):
        row[: len(values)] = values
    t_ns = np.array([t for t, _ in stamps], dtype=np.int64)
    return SampleBlock(kind=np.full(len(t_ns), Kind.ONBOARD, dtype=np.uint8), t_ns=t_ns, t_rx_ns=t_ns, data=data)


def lane_result(block: SampleBlock) -> StepResult:
    rows = repeat("onboard", block, None)
    assert rows is not None
    nothing = np.empty(0, dtype=np.int64)
    aids = AidRows(t_ns=nothing, data=np.empty((0, len(AID_COLUMNS))))
    filtered = FilteredRows(t_ns=nothing, data=np.empty((0, len(STEP_COLUMNS))))
    return StepResult(boot_id=0, block=block, lanes=(rows,), aids=aids, filtered=filtered, events=())


@pytest.mark.parametrize("topic", ["lanes/onboard", "raw/onboard"])
@pytest.mark.parametrize("cut", [1, 7, 100_000])
def test_history_keeps_attitude_and_place_of_a_board_that_reports_them_in_turns(topic: str, cut: int) -> None:
    """100 attitudes and 50 places a second, 5 ms apart: ten of each a second stay, none for the other."""
    history, block = History(row_topics(("onboard",)), span_s=20.0), reported(100, 50, 10)
    for start in range(0, len(block.t_ns), cut):
        part = slice(start, start + cut)
        fields = {name: getattr(block, name)[part] for name in ("kind", "t_ns", "t_rx_ns", "data")}
        history.add(lane_result(SampleBlock(**fields)))
    table = history.rows(topic, 1000.0)
    knows = {name: np.isfinite(table.data[:, column]) for name, column in (("q", 0), ("vel", 4 + 3 * ("raw" in topic)))}
    for known in knows.values():
        np.testing.assert_array_equal(np.diff(table.t_ns[known]), SECOND_NS // 10)
    assert [int(known.sum()) for known in knows.values()] == [100, 100]
    assert (np.diff(table.t_ns) > 0).all()


def test_rows_that_know_the_same_columns_are_one_group() -> None:
    rows = np.array([[1.0, np.nan, 0.0], [7.0, np.nan, 3.0], [np.nan, 1.0, 1.0]])
    groups = known_columns(rows)
    assert groups[0] == groups[1] != groups[2]
