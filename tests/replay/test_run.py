"""The contract of `replay`, on folders written by an independent generator, through the real engine."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from server.nav.lanes.registry import RECORDED_LANES as LANES
from server.nav.lanes.registry import parameters_of, provides_of
from server.replay.errors import ReplayError
from server.replay.run import replay
from tests.replay.sensor_folders import (
    ALT_M,
    FIELD_N_GAUSS,
    G_M_S2,
    LAT_DEG,
    LON_DEG,
    OUTPUT_HEADER,
    SECOND_NS,
    START_NS,
    read_csv,
    stamps_ns,
    static_board,
    write_csv,
)

YAW_RAD = 0.6
ZEROS = (0.0,) * 5


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return static_board(tmp_path_factory.mktemp("static"), yaw_rad=YAW_RAD)


@pytest.fixture(scope="module")
def result(board: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("result")
    replay(board, out)
    return out


def summary(out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def cell(header: list[str], row: list[str], name: str) -> float:
    text = row[header.index(name)]
    return float(text) if text else math.nan


def test_every_lane_has_exactly_the_columns_of_the_contract(result: Path) -> None:
    assert {path.name for path in result.iterdir()} == {"summary.json", *(f"{lane}.csv" for lane in LANES)}
    for lane in LANES:
        header, rows = read_csv(result / f"{lane}.csv")
        assert ",".join(header) == OUTPUT_HEADER
        assert all(len(row) == 27 for row in rows)


def test_there_is_one_row_per_navigation_step_in_ascending_board_time(result: Path) -> None:
    _, rows = read_csv(result / "ins_ekf.csv")
    stamps = [int(row[0]) for row in rows]
    assert abs(len(rows) - 40 * 50) <= 2
    assert all(b - a == SECOND_NS // 50 for a, b in pairwise(stamps))
    assert START_NS <= stamps[0] < stamps[-1] < START_NS + 40 * SECOND_NS


def test_the_rate_of_steps_is_as_told(board: Path, tmp_path: Path) -> None:
    replay(board, tmp_path, lanes=["ins_ekf"], nav_rate_hz=20.0)
    assert abs(len(read_csv(tmp_path / "ins_ekf.csv")[1]) - 40 * 20) <= 2


def test_a_board_at_rest_is_found_where_it_is_and_says_how_sure_it_is(result: Path) -> None:
    header, rows = read_csv(result / "ins_ekf.csv")
    last = rows[-1]
    assert last[-1] == "navigating"
    assert {row[-1] for row in rows} <= {"aligning", "attitude", "navigating"}
    assert abs(cell(header, last, "lat_deg") - LAT_DEG) < 5e-7
    assert abs(cell(header, last, "lon_deg") - LON_DEG) < 5e-7
    assert abs(cell(header, last, "alt_m") - ALT_M) < 0.3
    half_cos = cell(header, last, "q_w") * math.cos(YAW_RAD / 2) + cell(header, last, "q_z") * math.sin(YAW_RAD / 2)
    assert 2 * math.acos(min(1.0, abs(half_cos))) < math.radians(3)
    assert cell(header, last, "q_w") >= 0.0
    assert all(0.0 < cell(header, last, name) < 1.0 for name in header if name.startswith("sigma_"))


def test_before_a_position_only_the_attitude_is_there_and_before_that_nothing(result: Path) -> None:
    header, rows = read_csv(result / "ins_ekf.csv")
    first, last = header.index("vel_n_m_s"), header.index("alt_m")
    early = [row for row in rows if row[-1] in {"aligning", "attitude"}]
    assert early
    for row in early:
        assert set(row[first : last + 1]) == {""}
        assert (row[1] == "") == (row[-1] == "aligning")


def test_the_reference_lane_repeats_the_reference_and_nothing_else(result: Path, board: Path) -> None:
    header, rows = read_csv(result / "reference.csv")
    given_header, given = read_csv(board / "reference.csv")
    assert len(rows) == len(given)
    for name in given_header:
        assert [cell(header, row, name) for row in rows] == pytest.approx(
            [cell(given_header, row, name) for row in given]
        )
    assert all(row[header.index("sigma_pos_n_m")] == "" for row in rows)


def test_results_do_not_depend_on_where_the_stream_is_cut(board: Path, result: Path, tmp_path: Path) -> None:
    want = (result / "ins_ekf.csv").read_bytes()
    for rows in (1, 7, 100_000):
        out = tmp_path / str(rows)
        replay(board, out, lanes=["ins_ekf", "reference"], block_rows=rows)
        assert (out / "ins_ekf.csv").read_bytes() == want
        assert (out / "reference.csv").read_bytes() == (result / "reference.csv").read_bytes()


def test_the_reference_never_reaches_an_estimator(board: Path, result: Path, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for file in board.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    write_csv(
        folder, "reference", [(t, 0.0, 1.0, 0.0, 0.0, -12.0, 99.0, 9e3, 50.0, 60.0, 70.0) for t in stamps_ns(40, 50)]
    )
    write_csv(folder, "dmp", [(t, 0, 1 << 30, 0, 0) for t in stamps_ns(40, 30)])
    replay(folder, tmp_path / "out", lanes=["ins_ekf"])
    assert (tmp_path / "out" / "ins_ekf.csv").read_bytes() == (result / "ins_ekf.csv").read_bytes()


def test_the_summary_accounts_for_samples_aids_site_and_time(result: Path) -> None:
    found = summary(result)
    assert found["samples"] == {
        "imu": 8000, "mag": 800, "baro": 800, "gnss": 200, "airspeed": 0, "reference": 2000, "onboard": 0, "dmp": 0,
        "date": 0, "profile": 0,
    }  # fmt: skip
    assert set(found["losses"].values()) == {0}
    for aid, count in (("gnss_position", 200), ("baro_height", 800), ("mag_field", 800)):
        assert found["aids"][aid]["fused"] + sum(found["aids"][aid]["refused"].values()) == count, aid
        assert found["aids"][aid]["fused"] > 0.7 * count, aid
    assert found["aids"]["gnss_velocity"]["fused"] == found["aids"]["gnss_position"]["fused"]
    assert found["site"]["date_source"] == "settings"
    assert found["site"]["decimal_year"] == pytest.approx(2026 + 325 / 365)
    assert found["site"]["lat_deg"] == pytest.approx(LAT_DEG, abs=1e-5)
    timing = found["timing"]
    assert 0 < timing["engine_s"] < timing["total_s"]
    assert timing["read_s"] > 0
    assert timing["real_time_factor"] == pytest.approx(found["log"]["duration_s"] / timing["engine_s"])


def test_errors_are_reported_over_everything_and_from_30_s_after_the_fix(result: Path) -> None:
    lane = summary(result)["lanes"]["ins_ekf"]
    assert lane["settled"]["t_from_ns"] == START_NS + 30 * SECOND_NS
    assert lane["whole"]["rows"] > lane["settled"]["rows"] == pytest.approx(500, abs=1)
    assert lane["settled"]["horizontal_m"]["rms"] < 0.05
    assert lane["settled"]["attitude_rad"]["rms"] < math.radians(2)
    assert lane["settled"]["cover_3sigma"]["horizontal"] > 0.9


def gnss_withheld(out: Path) -> int:
    aids = summary(out)["aids"]
    assert aids["gnss_velocity"]["fused"] == aids["gnss_position"]["fused"]
    return aids["gnss_position"]["refused"].get("withheld", 0)


def test_an_outage_withholds_what_was_valid_in_it_not_what_was_stamped_in_it(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder")
    (folder / "meta.toml").write_text("[gnss]\ndelay_s = 0.5\n")
    replay(folder, tmp_path / "out", lanes=["ins_ekf"], gnss_outages=[(20.0, 25.0), (30.0, 30.3)])
    valid_s = [k / 5 - 0.5 for k in range(200)]  # as the generator wrote them, every 0.2 s from the first sample
    want = sum(20.0 <= s < 25.0 for s in valid_s) + sum(30.0 <= s < 30.3 for s in valid_s)
    assert gnss_withheld(tmp_path / "out") == want
    stretches = summary(tmp_path / "out")["lanes"]["ins_ekf"]["outages"]
    assert [(s["from_s"], s["to_s"]) for s in stretches] == [(20.0, 25.0), (30.0, 30.3)]
    assert stretches[0]["rows"] == 250
    assert 0 < stretches[0]["end_horizontal_m"] <= stretches[0]["peak_horizontal_m"] < 5.0


def test_outages_count_from_the_earliest_stamp_of_any_file(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder")
    replay(folder, tmp_path / "a", lanes=["ins_ekf"], gnss_outages=[(20.0, 22.0)])
    write_csv(folder, "airspeed", [(START_NS - 3 * SECOND_NS, None, 0.0)])
    replay(folder, tmp_path / "b", lanes=["ins_ekf"], gnss_outages=[(23.0, 25.0)])
    assert gnss_withheld(tmp_path / "a") == gnss_withheld(tmp_path / "b") == 10
    header, rows = read_csv(tmp_path / "a" / "ins_ekf.csv")
    _, shifted = read_csv(tmp_path / "b" / "ins_ekf.csv")
    assert summary(tmp_path / "b")["settings"]["t_origin_ns"] == START_NS - 3 * SECOND_NS
    assert cell(header, shifted[-1], "lat_deg") == pytest.approx(cell(header, rows[-1], "lat_deg"), abs=1e-8)


def test_an_aid_that_is_switched_off_is_refused_and_says_so(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=15.0)
    (folder / "meta.toml").write_text("[aids]\nbaro = false\n")
    replay(folder, tmp_path / "out", lanes=["ins_ekf"])
    assert summary(tmp_path / "out")["aids"]["baro_height"] == {"fused": 0, "refused": {"disabled": 300}}


def test_without_fix_and_site_there_is_attitude_but_no_place(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=20.0, yaw_rad=YAW_RAD)
    (folder / "gnss.csv").unlink()
    (folder / "meta.toml").unlink()
    replay(folder, tmp_path / "out", lanes=["ins_ekf"])
    header, rows = read_csv(tmp_path / "out" / "ins_ekf.csv")
    assert rows[-1][-1] == "attitude"
    assert [rows[-1][header.index(name)] for name in ("lat_deg", "lon_deg")] == ["", ""]
    magnetic_rad = YAW_RAD - math.atan2(FIELD_N_GAUSS[1], FIELD_N_GAUSS[0])  # heading from magnetic north
    yaw_rad = 2 * math.atan2(cell(header, rows[-1], "q_z"), cell(header, rows[-1], "q_w"))
    assert yaw_rad == pytest.approx(magnetic_rad, abs=math.radians(1))


def test_no_date_is_the_model_s_epoch_and_is_reported(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=10.0)
    (folder / "meta.toml").unlink()
    replay(folder, tmp_path / "out")
    site = summary(tmp_path / "out")["site"]
    assert (site["date_source"], site["decimal_year"]) == ("model-epoch", 2025.0)


def test_without_imu_the_other_lanes_still_run_and_ins_ekf_says_why_not(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    write_csv(folder, "reference", [(t, 1, 0, 0, 0, 47, 8, 500, *ZEROS[:3]) for t in stamps_ns(2, 10)])
    replay(folder, tmp_path / "out")
    assert len(read_csv(tmp_path / "out" / "reference.csv")[1]) == 20
    assert read_csv(tmp_path / "out" / "ins_ekf.csv") == (OUTPUT_HEADER.split(","), [])
    assert "ins_ekf: no row; the log has no imu samples." in summary(tmp_path / "out")["notes"]


def test_files_with_headers_only_give_empty_lanes(tmp_path: Path) -> None:
    write_csv(tmp_path / "folder", "imu", [])
    replay(tmp_path / "folder", tmp_path / "out")
    assert summary(tmp_path / "out")["lanes"]["ins_ekf"]["rows"] == 0
    assert summary(tmp_path / "out")["timing"]["real_time_factor"] is None


def test_unknown_cells_are_no_samples_of_zero(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=15.0)
    field = [(t, *(FIELD_N_GAUSS if t < 10_000_000_000 else (None,) * 3)) for t in stamps_ns(15, 20)]
    write_csv(folder, "mag", field)
    gnss = [(t, LAT_DEG, LON_DEG, ALT_M, None, None, None, None, None, None, None) for t in stamps_ns(15, 5)]
    write_csv(folder, "gnss", gnss)
    replay(folder, tmp_path / "out", lanes=["ins_ekf"])
    aids = summary(tmp_path / "out")["aids"]
    assert 0 < aids["mag_field"]["fused"] <= 5 * 20
    assert aids["gnss_velocity"]["fused"] == 0
    assert aids["gnss_position"]["fused"] > 0


def test_stamps_of_a_unix_clock_are_exact(tmp_path: Path) -> None:
    start_ns = 1_795_312_368_672_182_001
    write_csv(tmp_path / "folder", "imu", [(t, 0, 0, 0, 0, 0, -G_M_S2) for t in stamps_ns(4, 200, start_ns)])
    write_csv(tmp_path / "folder", "reference", [(start_ns + 1, 1, 0, 0, 0, 47, 8, 500, *ZEROS[:3])])
    replay(tmp_path / "folder", tmp_path / "out")
    assert read_csv(tmp_path / "out" / "reference.csv")[1][0][0] == str(start_ns + 1)
    stamps = {int(row[0]) for row in read_csv(tmp_path / "out" / "ins_ekf.csv")[1]}
    assert stamps <= set(stamps_ns(4, 200, start_ns))
    assert len(stamps) > 190


def test_a_lane_nobody_knows_writes_nothing(board: Path, tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="Known: ins_ekf, "):
        replay(board, tmp_path / "out", lanes=["ins_ukf"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, math.nan, 1e9])
def test_a_rate_that_cannot_be_is_refused(board: Path, tmp_path: Path, rate_hz: float) -> None:
    with pytest.raises(ReplayError, match="nav_rate_hz"):
        replay(board, tmp_path / "out", nav_rate_hz=rate_hz)


def test_every_lane_says_what_it_provides_and_is_scored_on_that_alone(result: Path) -> None:
    lanes = summary(result)["lanes"]
    assert set(lanes) == set(LANES)
    for name, lane in lanes.items():
        assert (lane["provides"], lane["failure"]) == (provides_of(name), "")
        whole = lane["whole"]
        if whole is not None and lane["provides"] == "altitude":
            assert whole["attitude_rad"] is whole["horizontal_m"] is whole["cover_3sigma"]["attitude"] is None
            assert whole["vertical_m"]["rows"] > 0
        if whole is not None and lane["provides"] == "attitude":
            assert whole["horizontal_m"] is whole["vertical_m"] is whole["vel_n_m_s"] is None
            assert whole["attitude_rad"]["rows"] > 0


def test_a_parameter_that_is_set_reaches_its_lane_and_the_summary_names_it(
    board: Path, result: Path, tmp_path: Path
) -> None:
    assert summary(result)["settings"]["lane_parameters"] == {}
    tried = 0
    for lane in LANES:
        for one in parameters_of(lane)[:1]:
            other = one.minimum if one.minimum != one.default else one.maximum
            replay(board, tmp_path / lane, lanes=[lane], lane_parameters={lane: {one.name: other}})
            assert summary(tmp_path / lane)["settings"]["lane_parameters"] == {lane: {one.name: other}}
            tried += 1
            if not math.isnan(one.default):
                replay(board, tmp_path / "same", lanes=[lane], lane_parameters={lane: {one.name: one.default}})
                assert summary(tmp_path / "same")["settings"]["lane_parameters"] == {}
                assert (tmp_path / "same" / f"{lane}.csv").read_bytes() == (result / f"{lane}.csv").read_bytes()
    assert tried


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"nope": {"x": 1.0}}, "no lane called nope; there are: ins_ekf"),
        ({"ins_ekf": {"no_such": 1.0}}, "no parameter no_such; there are:"),
        ({"reference": {"x": 1.0}}, "no parameter x"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_with_those_there_are(
    board: Path, tmp_path: Path, values: dict[str, dict[str, float]], says: str
) -> None:
    with pytest.raises(ReplayError, match=says):
        replay(board, tmp_path / "out", lane_parameters=values)
    assert list(tmp_path.iterdir()) == []


def test_a_value_outside_its_limits_is_refused_with_them(board: Path, tmp_path: Path) -> None:
    lane, one = next((lane, one) for lane in LANES for one in parameters_of(lane))
    with pytest.raises(ReplayError, match=f"outside {one.minimum:g} … {one.maximum:g}"):
        replay(board, tmp_path / "out", lane_parameters={lane: {one.name: one.maximum + 1.0}})


def test_what_is_set_of_a_lane_that_does_not_run_is_noted(board: Path, tmp_path: Path) -> None:
    lane, one = next((lane, one) for lane in LANES for one in parameters_of(lane))
    replay(board, tmp_path / "out", lanes=["reference"], lane_parameters={lane: {one.name: one.maximum}})
    assert [note for note in summary(tmp_path / "out")["notes"] if lane in note]


@pytest.mark.parametrize(("date", "used"), [("2035-01-01", 2030.0), ("2001-01-01", 2010.0)])
def test_a_date_the_magnetic_model_does_not_cover_is_noted(tmp_path: Path, date: str, used: float) -> None:
    folder = static_board(tmp_path / "folder", duration_s=3.0)
    replay(folder, tmp_path / "fine", lanes=["ins_ekf"])
    assert summary(tmp_path / "fine")["notes"] == []
    (folder / "meta.toml").write_text(f"[site]\ndate = {date}\n")
    replay(folder, tmp_path / "out", lanes=["ins_ekf"])
    (note,) = summary(tmp_path / "out")["notes"]
    assert f"the date {date[:4]}.00 is outside the magnetic model's life, 2010.0 to 2030.0" in note
    assert summary(tmp_path / "out")["site"]["decimal_year"] == used


def test_progress_only_grows_and_ends_at_one(board: Path, tmp_path: Path) -> None:
    told: list[float] = []
    replay(board, tmp_path / "out", progress=told.append, block_rows=500)
    assert told == sorted(told)
    assert len(told) > 10
    assert told[-1] == 1.0
