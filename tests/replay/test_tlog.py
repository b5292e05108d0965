"""Recorded serial streams of a real autopilot through `replay`; truth decoded by pymavlink, apart from our decoder."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as dialect

from server.nav.lanes.registry import RECORDED_LANES as LANES
from server.replay.errors import ReplayError
from server.replay.run import replay
from tests.replay.sensor_folders import OUTPUT_HEADER, SECOND_NS, read_csv

SIM_STATE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT, GPS_RAW_INT, HIGHRES_IMU = 108, 31, 33, 24, 105
COLUMN = {name: k for k, name in enumerate(OUTPUT_HEADER.split(","))}


def records(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (microseconds, frame) of a .tlog of MAVLink 2 frames."""
    raw, at = path.read_bytes(), 0
    while at < len(raw):
        end = at + 8 + 12 + raw[at + 9] + (13 if raw[at + 10] & 1 else 0)
        yield struct.unpack(">Q", raw[at : at + 8])[0], raw[at + 8 : end]
        at = end


def message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


def messages(path: Path, *ids: int) -> Iterator[Any]:
    decoder = dialect.MAVLink(None)
    for _, frame in records(path):
        if frame[5] == 1 and message_id(frame) in ids:
            yield decoder.decode(bytearray(frame))


def write_tlog(path: Path, parts: list[tuple[int, bytes]]) -> Path:
    path.write_bytes(b"".join(struct.pack(">Q", stamp_us) + frame for stamp_us, frame in parts))
    return path


def summary(out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def static_log(shared_data: Path) -> Path:
    return shared_data / "ardupilot_sitl" / "static.tlog"


@pytest.fixture(scope="module")
def mission_log(shared_data: Path) -> Path:
    return shared_data / "ardupilot_sitl" / "mission.tlog"


@pytest.fixture(scope="module")
def static(static_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("static")
    replay(static_log, out)
    return out


@pytest.fixture(scope="module")
def mission(mission_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("mission")
    replay(mission_log, out)
    return out


def test_the_reference_is_sim_state_at_the_preceding_attitude_s_stamp(mission_log: Path, mission: Path) -> None:
    want, stamp_ms = [], None
    for message in messages(mission_log, SIM_STATE, ATTITUDE_QUATERNION):
        if message.get_type() == "ATTITUDE_QUATERNION":
            stamp_ms = message.time_boot_ms
        elif stamp_ms is not None:
            sign = math.copysign(1.0, message.q1)
            q_nb = [sign * part for part in (message.q1, message.q2, message.q3, message.q4)]
            place = [message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt]
            want.append([stamp_ms * 1_000_000, *q_nb, message.vn, message.ve, message.vd, *place])
    _, rows = read_csv(mission / "reference.csv")
    assert len(rows) == len(want) > 18_000
    for row, wanted in zip(rows[::50], want[::50], strict=True):
        assert int(row[0]) == wanted[0]
        assert [float(cell) for cell in row[1:11]] == pytest.approx(wanted[1:], rel=1e-12, abs=1e-12)


def test_onboard_is_what_the_autopilot_says_of_itself(mission_log: Path, mission: Path) -> None:
    said = list(messages(mission_log, GLOBAL_POSITION_INT))
    _, rows = read_csv(mission / "onboard.csv")
    placed = [row for row in rows if row[COLUMN["lat_deg"]]]
    assert len(placed) == len(said)
    for row, message in zip(placed[::100], said[::100], strict=True):
        assert int(row[0]) == message.time_boot_ms * 1_000_000
        assert float(row[COLUMN["lat_deg"]]) == pytest.approx(message.lat * 1e-7, abs=1e-12)
        assert float(row[COLUMN["vel_e_m_s"]]) == pytest.approx(message.vy * 1e-2, abs=1e-12)


def test_the_mission_is_navigated_within_what_was_asked(mission: Path) -> None:
    found = summary(mission)["lanes"]["ins_ekf"]["settled"]
    assert math.degrees(found["attitude_rad"]["rms"]) <= 0.50
    assert found["horizontal_m"]["rms"] <= 0.06
    assert found["vertical_less_median_m"]["rms"] <= 0.06
    assert [found[name]["rms"] <= 0.022 for name in ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")] == [True] * 3
    assert found["cover_3sigma"]["horizontal"] >= 0.95
    assert found["sigma_ratio_horizontal"] <= 4.0


def test_the_autopilot_s_own_errors_come_out_as_published(mission: Path) -> None:
    found = summary(mission)["lanes"]["onboard"]["settled"]
    assert math.degrees(found["attitude_rad"]["rms"]) == pytest.approx(0.70, abs=0.01)
    assert math.degrees(found["heading_rad"]["rms"]) == pytest.approx(0.69, abs=0.01)


def test_the_summary_of_a_clean_stream_has_no_loss_and_the_board_s_date(mission: Path) -> None:
    found = summary(mission)
    for reason in ("frames_lost", "crc_errors", "bytes_junk", "bytes_incomplete", "damaged_records"):
        assert found["losses"][reason] == 0, reason
    assert found["log"]["board"].startswith("ArduPilot")
    assert found["site"]["date_source"] == "board"
    assert found["site"]["decimal_year"] == pytest.approx(2026.89, abs=0.01)
    assert found["log"]["duration_s"] == pytest.approx(182.1, abs=0.3)


def test_a_board_at_rest_stays_at_rest(static: Path) -> None:
    found = summary(static)["lanes"]["ins_ekf"]["settled"]
    assert found["horizontal_m"]["rms"] < 0.1
    assert max(found[name]["rms"] for name in ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")) < 0.05
    assert math.degrees(found["heading_rad"]["rms"]) < 3.5  # the board itself is at 3.3°: its field is off the model's


def test_blocks_of_any_size_give_the_same_bytes(static_log: Path, static: Path, tmp_path: Path) -> None:
    for rows in (97, 1 << 20):
        replay(static_log, tmp_path / str(rows), block_rows=rows)
        for lane in ("ins_ekf", "onboard", "reference"):
            assert (tmp_path / str(rows) / f"{lane}.csv").read_bytes() == (static / f"{lane}.csv").read_bytes()


def test_truth_and_the_autopilot_s_own_estimate_never_reach_an_estimator(
    mission_log: Path, mission: Path, tmp_path: Path
) -> None:
    hidden = {SIM_STATE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT}
    log = write_tlog(tmp_path / "bare.tlog", [r for r in records(mission_log) if message_id(r[1]) not in hidden])
    replay(log, tmp_path / "out", lanes=["ins_ekf"])
    assert (tmp_path / "out" / "ins_ekf.csv").read_bytes() == (mission / "ins_ekf.csv").read_bytes()
    assert summary(tmp_path / "out")["lanes"]["ins_ekf"]["whole"] is None


def test_an_outage_withholds_the_fixes_that_were_valid_in_it(mission_log: Path, tmp_path: Path) -> None:
    replay(mission_log, tmp_path / "out", gnss_outages=[(60.0, 85.0)])
    first_us = next(messages(mission_log, HIGHRES_IMU)).time_usec
    fixes_us = {message.time_usec for message in messages(mission_log, GPS_RAW_INT)}
    valid_s = [(stamp_us - 98_000 - first_us) * 1e-6 for stamp_us in fixes_us]  # delay of this board's protocol
    found = summary(tmp_path / "out")
    assert found["aids"]["gnss_position"]["refused"]["withheld"] == sum(60.0 <= s < 85.0 for s in valid_s) > 100
    stretch = found["lanes"]["ins_ekf"]["outages"][0]
    assert stretch["peak_horizontal_m"] < 30.0
    assert stretch["peak_horizontal_sigmas"] < 3.0
    start_ns = found["settings"]["t_origin_ns"] + 60 * SECOND_NS
    inside = [row for row in read_csv(tmp_path / "out" / "ins_ekf.csv")[1] if 5 <= (int(row[0]) - start_ns) / 1e9 < 25]
    assert {row[-1] for row in inside} == {"dead_reckoning"}


def test_a_reboot_in_the_log_starts_new_files_with_the_same_outcome(static_log: Path, tmp_path: Path) -> None:
    head = list(records(static_log))[:30_000]  # about 26 s
    again = [(stamp_us + 40_000_000, frame) for stamp_us, frame in head]
    replay(write_tlog(tmp_path / "once.tlog", head), tmp_path / "once")
    replay(write_tlog(tmp_path / "twice.tlog", head + again), tmp_path / "twice")
    found = summary(tmp_path / "twice")
    assert found["log"]["boots"] == 2
    assert set(found["lanes"]) == {f"{lane}{boot}" for lane in LANES for boot in ("", ".boot1")}
    _, once = read_csv(tmp_path / "once" / "ins_ekf.csv")
    _, second = read_csv(tmp_path / "twice" / "ins_ekf.boot1.csv")
    assert read_csv(tmp_path / "twice" / "ins_ekf.csv")[1] == once
    assert len(second) == pytest.approx(len(once), abs=1)
    assert abs(int(second[-1][0]) - int(once[-1][0])) <= 20_000_000  # the decoder may need a sample to be sure
    for name in ("lat_deg", "lon_deg"):
        assert float(second[-1][COLUMN[name]]) == pytest.approx(float(once[-1][COLUMN[name]]), abs=2e-7)
    assert second[-1][-1] == once[-1][-1] == "navigating"


def test_a_log_of_a_silent_ground_station_says_what_is_missing(static_log: Path, tmp_path: Path) -> None:
    log = write_tlog(tmp_path / "gcs.tlog", [r for r in records(static_log) if r[1][5] == 255])
    with pytest.raises(ReplayError, match=r"no sample among them\. Ask the board for HIGHRES_IMU"):
        replay(log, tmp_path / "out")
    assert not (tmp_path / "out").exists()
