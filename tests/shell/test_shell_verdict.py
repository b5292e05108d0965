"""The verdict: what is said of a board, in which order, and that a board that is well is left in peace."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from server.board_view import BoardView
from server.link.base import LinkState, LinkStatus
from server.nav import health
from server.nav.lanes.registry import LaneInfo
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    Aid,
    AidHealth,
    AidStatus,
    LaneState,
    LaneStatus,
    SensorHealth,
    Site,
    Snapshot,
)
from server.protocol.base import ProtocolStats
from server.traffic import Finding, Recent, Traffic
from server.verdict import NOTES, judge, worst
from tests.shell.shell_fakes import STATUS_AT, lane_row

NOW_NS, T_NS = 100_000_000_000, 50_000_000_000
IMU = SensorHealth(name="imu", t_last_ns=T_NS, rate_hz=333.0, samples=1000, repeated=0, refused=())


def aid_health(status: AidStatus, t_fused_ns: int) -> AidHealth:
    last = [0.0] * len(AID_COLUMNS)
    last[1] = status
    return AidHealth(aid=Aid.GNSS_POSITION, fused=1, refused=(), t_fused_ns=t_fused_ns, last=tuple(last))


def snapshot_of(**changes: object) -> Snapshot:
    lane = LaneState(lane="ins_ekf", provides="full", t_ns=T_NS, row=lane_row(1))
    whole = Snapshot(
        boot_id=0, t_ns=T_NS, lanes=(lane,), sensors=(IMU,), aids=(), site=None, filtered=(), events=(), steps=1
    )
    return replace(whole, **changes)


WELL = BoardView(
    id="a",
    url="a:",
    lanes=("ins_ekf",),
    topics=(),
    state="running",
    cause="",
    remedy="",
    now_ns=NOW_NS,
    t_ns=T_NS,
    t_rx_ns=NOW_NS - 10_000_000,
    link=LinkStatus(url="a:", state=LinkState.OPEN),
    stats=ProtocolStats(protocol="mavlink", clock_drift_ppm=400.0),
    recent=Recent(span_s=5.0, bytes_in=100_000, frames=2000),
    snapshot=snapshot_of(),
    events=(),
    latencies_s=(),
)


def with_lane(status: LaneStatus, dead_reckoning_s: float = 0.0) -> BoardView:
    row = lane_row(1, status)
    row[LANE_COLUMNS.index("dead_reckoning_s")] = dead_reckoning_s
    return replace(WELL, snapshot=snapshot_of(lanes=(LaneState(lane="ins_ekf", provides="full", t_ns=T_NS, row=row),)))


def test_a_board_that_is_well_has_an_empty_verdict() -> None:
    assert judge(WELL) == ()
    assert worst(()) == "ok"


@pytest.mark.parametrize(
    ("view", "severity", "code"),
    [
        (replace(WELL, state="failed", cause="c", remedy="r"), "warning", "board-failed"),
        (replace(WELL, link=LinkStatus(url="", state=LinkState.LOST, code="unplugged")), "warning", "unplugged"),
        (replace(WELL, t_rx_ns=NOW_NS - 1_500_000_000), "caution", "no-data"),
        (replace(WELL, t_rx_ns=NOW_NS - 3_500_000_000), "warning", "no-data"),
        (replace(WELL, t_rx_ns=-1, t_ns=-1), "caution", "no-samples"),
        (replace(WELL, t_rx_ns=-1, recent=Recent(span_s=5, bytes_in=900)), "warning", "no-frames"),
        (replace(WELL, recent=Recent(span_s=5, bytes_in=9000, frames=100, lost=2)), "caution", "frames-lost"),
        (replace(WELL, recent=Recent(span_s=5, bytes_in=9000, frames=9, bytes_junk=900)), "caution", "line-noise"),
        (replace(WELL, stats=replace(WELL.stats, clock_drift_ppm=-2500.0)), "caution", "clock-drift"),
        (replace(WELL, stats=replace(WELL.stats, code="interval-refused", cause="c")), "caution", "interval-refused"),
        (replace(WELL, snapshot=snapshot_of(sensors=(replace(IMU, rate_hz=50.0),))), "caution", "imu-slow"),
        (replace(WELL, snapshot=snapshot_of(sensors=(replace(IMU, t_last_ns=-1),))), "warning", "imu-missing"),
        (replace(WELL, snapshot=snapshot_of(sensors=(replace(IMU, t_last_ns=0),))), "warning", "sensor-stale"),
        (replace(WELL, snapshot=snapshot_of(sensors=(replace(IMU, note="odd"),))), "caution", "odd"),
        (replace(WELL, snapshot=snapshot_of(sensors=(replace(IMU, note="imu-stuck"),))), "warning", "imu-stuck"),
        (
            replace(WELL, snapshot=snapshot_of(aids=(aid_health(AidStatus.REFUSED_NO_FIX, T_NS - 6 * 10**9),))),
            "caution",
            "aid-refused-no-fix",
        ),
        (with_lane(LaneStatus.ALIGNING), "info", "lane-aligning"),
        (with_lane(LaneStatus.ATTITUDE), "caution", "lane-attitude-only"),
        (with_lane(LaneStatus.DEAD_RECKONING, 3.0), "caution", "dead-reckoning"),
        (with_lane(LaneStatus.DEAD_RECKONING, 12.0), "warning", "dead-reckoning"),
        (with_lane(LaneStatus.FAILED), "warning", "lane-failed"),
    ],
)
def test_each_trouble_is_said_with_its_severity(view: BoardView, severity: str, code: str) -> None:
    first = judge(view)[0]
    assert (first.severity, first.code) == (severity, code)


@pytest.mark.parametrize(
    "aid",
    [
        aid_health(AidStatus.FUSED, T_NS),
        aid_health(AidStatus.REFUSED_GATE, T_NS - 10**9),  # once refused, but used a second ago
        aid_health(AidStatus.REFUSED_MOVING, -1),
        aid_health(AidStatus.REFUSED_DISABLED, -1),
    ],
)
def test_an_aid_that_does_what_it_should_is_no_trouble(aid: AidHealth) -> None:
    assert judge(replace(WELL, snapshot=snapshot_of(aids=(aid,)))) == ()


def lane_info(name: str, failure: str) -> LaneInfo:
    return LaneInfo(name=name, provides="full", running=not failure, failure=failure, parameters=(), values={})


@pytest.mark.parametrize(("name", "severity"), [("ins_ekf", "warning"), ("other", "caution")])
def test_a_lane_that_was_put_aside_is_named_once_with_its_cause_and_remedy(name: str, severity: str) -> None:
    failed = LaneState(lane=name, provides="full", t_ns=T_NS, row=lane_row(1, LaneStatus.FAILED), failure="E: x")
    view = replace(WELL, lanes=("ins_ekf", "other"), lane_infos=(lane_info(name, "E: x"), lane_info("third", "E: y")))
    (line,) = judge(replace(view, snapshot=snapshot_of(lanes=(failed,))))
    assert (line.severity, line.code, line.subject) == (severity, "lane-put-aside", f"lane:{name}")
    assert "E: x" in line.cause
    assert "Choose it again" in line.remedy


def test_of_a_lane_beside_the_main_one_only_its_failure_is_a_trouble() -> None:
    for status, severities in ((LaneStatus.ALIGNING, []), (LaneStatus.FAILED, ["caution"])):
        other = LaneState(lane="other", provides="full", t_ns=T_NS, row=lane_row(1, status))
        view = replace(WELL, lanes=("ins_ekf", "other"), snapshot=snapshot_of(lanes=(*WELL.snapshot.lanes, other)))
        assert [line.severity for line in judge(view)] == severities


@pytest.mark.parametrize(
    ("year", "source", "codes"),
    [
        (2030.0, "board", ["magnetic-model-date"]),
        (2010.0, "settings", ["magnetic-model-date"]),
        (2029.9, "board", []),
        (2025.0, "model-epoch", []),
    ],
)
def test_a_date_beyond_the_magnetic_model_is_said(year: float, source: str, codes: list[str]) -> None:
    site = Site(
        lat_deg=47.0, lon_deg=8.0, alt_m=0.0, gravity_m_s2=9.8, declination_rad=0.0, field_n_gauss=(0.2, 0.0, 0.4),
        decimal_year=year, date_source=source,
    )  # fmt: skip
    assert [line.code for line in judge(replace(WELL, snapshot=snapshot_of(site=site)))] == codes


def test_the_worst_comes_first() -> None:
    bad = replace(with_lane(LaneStatus.FAILED), stats=replace(WELL.stats, clock_drift_ppm=5000.0))
    assert [line.severity for line in judge(bad)] == ["warning", "caution"]


def test_what_hangs_on_a_dead_link_is_not_said_again() -> None:
    lost = replace(WELL, link=LinkStatus(url="", state=LinkState.LOST, code="unplugged"), t_rx_ns=NOW_NS - 10**10)
    assert [line.code for line in judge(lost)] == ["unplugged"]


def test_a_lane_without_a_status_is_aligning() -> None:
    row = np.full(len(LANE_COLUMNS), np.nan)
    assert np.isnan(row[STATUS_AT])
    lane = LaneState(lane="ins_ekf", provides="full", t_ns=-1, row=row)
    assert judge(replace(WELL, snapshot=snapshot_of(lanes=(lane,))))[0].code == "lane-aligning"


def test_bytes_are_judged_until_they_make_frames() -> None:
    finding = Finding(LinkState.WRONG_BAUD, "wrong-baud", "Noise.", "Change it.", {"baud": "9600"})
    traffic = Traffic("a:", lambda data, _url: finding if len(data) >= 4 else None)
    status = LinkStatus(url="a:", state=LinkState.OPEN)
    for second, (count, frames) in enumerate([(2, 0), (4, 0), (6, 1)]):
        traffic.keep(b"xx")
        status = replace(status, bytes_in=count)
        traffic.read(second * 10**9, status, ProtocolStats(protocol="p", frames=frames))
        expected = LinkState.WRONG_BAUD if second == 1 else LinkState.OPEN
        assert traffic.judged(status).state is expected
    assert traffic.recent == Recent(span_s=2.0, bytes_in=4, frames=1)


def test_counters_that_start_again_do_not_count_backwards() -> None:
    traffic = Traffic("a:", lambda _data, _url: None)
    for second, frames in enumerate([100, 200, 5, 15]):
        traffic.read(
            second * 10**9, LinkStatus(url="a:", state=LinkState.OPEN), ProtocolStats(protocol="", frames=frames)
        )
    assert traffic.recent.frames == 10


def test_every_note_of_the_engine_has_its_own_words() -> None:
    """The core's source names the notes; a new one without a cause and a remedy would reach people as a bare key."""
    source = Path(health.__file__).read_text("utf-8")
    notes = set(re.findall(r'return "((?:imu|mag|baro|gnss|airspeed)-[a-z-]+)"', source))
    assert notes
    assert notes <= set(NOTES)
