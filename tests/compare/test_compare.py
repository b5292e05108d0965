"""`navdeck compare LOG` on a real autopilot's stream."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from server.compare.command import compare_command
from server.compare.contract import CompareOut
from server.compare.delay import delays
from server.compare.flight import fly
from server.compare.options import options_from_text
from server.compare.run import compare_log
from server.compare.schemas import schemas, shipped
from server.compare.tables import main_window
from server.magnetic import wmm_field
from server.nav.lanes.registry import RECORDED_LANES as LANES
from server.nav.lanes.registry import defaults_of
from server.nav.types import EngineSettings
from server.replay.errors import ReplayError
from server.replay.run import nav_engine, replay
from server.replay.schemas import schema_text
from server.replay.source import load
from tests.compare.made import cut_log
from tests.compare.test_report import outline

WINDOW = "40:60"
LARGEST_BYTES = 5_000_000


@pytest.fixture(scope="module")
def log(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 70 s or so of a flight."""
    return cut_log(shared_data / "ardupilot_sitl" / "mission.tlog", tmp_path_factory.mktemp("log") / "cut.tlog", 5.0)


@pytest.fixture(scope="module")
def short(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few seconds, where figures do not matter."""
    return cut_log(shared_data / "ardupilot_sitl" / "mission.tlog", tmp_path_factory.mktemp("log") / "short.tlog", 0.8)


@pytest.fixture(scope="module")
def folder(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "compared"
    compare_command(log, options_from_text(windows=[WINDOW], gnss_outages=["45:50"]), out=out)
    return out


@pytest.fixture(scope="module")
def compared(folder: Path) -> CompareOut:
    return CompareOut.model_validate_json((folder / "compare.json").read_bytes())


@pytest.mark.parametrize("name", sorted(schemas()))
def test_the_shipped_schema_is_the_generated_one(name: str) -> None:
    Draft202012Validator.check_schema(shipped(name))
    assert schema_text(shipped(name)) == schema_text(schemas()[name])


def test_the_json_fits_its_schema_and_has_every_lane(folder: Path, compared: CompareOut) -> None:
    found = json.loads((folder / "compare.json").read_bytes())
    Draft202012Validator(shipped("compare.schema.json")).validate(found)
    assert set(compared.lanes) == set(LANES)
    assert list(compared.windows) == ["whole", "settled", WINDOW]


def test_errors_are_those_that_replay_gives(log: Path, compared: CompareOut, tmp_path: Path) -> None:
    lanes = ["ins_ekf", "vqf", "onboard", "reference"]
    summary = replay(log, tmp_path / "out", lanes=lanes, gnss_outages=[(45.0, 50.0)])
    for name in lanes:
        ours, theirs = compared.lanes[name], summary.lanes[name]
        assert ours.windows["whole"].error == theirs.whole
        assert ours.windows["settled"].error == theirs.settled
        assert ours.windows["whole"].status_rows == theirs.status_rows


def test_a_lane_does_not_differ_from_itself(log: Path) -> None:
    found = compare_log(log, options_from_text(lanes="ins_ekf,onboard", chosen="onboard"), with_cost=False).out
    assert found.lanes["onboard"].windows["whole"].difference is None
    ours = found.lanes["ins_ekf"].windows["settled"].difference
    back = compare_log(log, options_from_text(lanes="onboard"), with_cost=False).out
    theirs = back.lanes["onboard"].windows["settled"].difference
    assert ours.attitude_rad.rms == pytest.approx(theirs.attitude_rad.rms, rel=0.1)


def test_each_lane_costs_something_and_repeaters_nothing(compared: CompareOut) -> None:
    for name, lane in compared.lanes.items():
        if name in {"onboard", "reference"}:
            assert lane.cost is None
        else:
            assert lane.cost.steps > 2000
            assert 0.0 < lane.cost.ns_per_step < 1e6
    assert compared.lanes["ins_ekf"].cost.ns_per_step > compared.lanes["complementary_1"].cost.ns_per_step


def test_the_main_lane_is_in_step_with_the_truth(compared: CompareOut) -> None:
    delay = compared.lanes["ins_ekf"].windows["settled"].delay
    assert abs(delay.attitude.delay_s) < 0.005
    assert abs(delay.vertical.delay_s) < 0.01
    assert compared.lanes["reference"].windows["settled"].delay is None


def test_a_truth_that_runs_ahead_makes_every_lane_late_by_as_much(log: Path) -> None:
    lanes = ("ins_ekf", "vqf")
    flown = fly(load(log).blocks(8192), nav_engine(EngineSettings(lanes=lanes), wmm_field)).flights[0]
    truth = flown.rows("reference")
    ahead = type(truth)(t_ns=truth.t_ns - 60_000_000, data=truth.data)
    for lane in lanes:
        rows = flown.rows(lane)
        plain, shifted = delays(rows, truth).attitude, delays(rows, ahead).attitude
        assert shifted.delay_s - plain.delay_s == pytest.approx(0.06, abs=0.002)


def test_the_page_is_whole_self_contained_and_small(folder: Path) -> None:
    html = (folder / "report.html").read_text(encoding="utf-8")
    outline(html)
    assert len(html.encode()) < LARGEST_BYTES
    assert "://" not in html
    for label in ("roll, °", "height, m", "north, m", "velocity east, m/s", "± 3 σ"):
        assert label in html


def test_a_parameter_reaches_its_lane_alone(log: Path) -> None:
    changed = 3.0 * defaults_of("complementary_1")["time_constant_s"]
    told = [f"complementary_1.time_constant_s={changed}"]
    one = compare_log(log, options_from_text(lanes="complementary_1,vqf", parameters=told), with_cost=False).out
    two = compare_log(log, options_from_text(lanes="complementary_1,vqf"), with_cost=False).out
    assert one.lanes["complementary_1"].parameters["time_constant_s"] == changed
    ours, theirs = (out.lanes["complementary_1"].windows["whole"].error for out in (one, two))
    assert ours != theirs
    assert one.lanes["vqf"].windows["whole"].error == two.lanes["vqf"].windows["whole"].error


def test_without_a_reference_the_board_is_compared_with_and_said_so(log: Path) -> None:
    found = compare_log(log, options_from_text(lanes="ins_ekf", reference="onboard"), with_cost=False).out
    assert found.reference == "onboard"
    assert "reference" not in found.lanes
    assert any("itself an estimate" in note for note in found.notes)
    assert found.lanes["ins_ekf"].windows["whole"].error.attitude_rad.rms > 0.0


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"lanes": "ins_ek"}, "did you mean ins_ekf"),
        ({"chosen": "nobody"}, "nobody"),
        ({"reference": "truth"}, "truth"),
        ({"windows": ["9:3"]}, "9:3"),
        ({"windows": ["soon"]}, "60:90"),
        ({"parameters": ["ins_ekf.nothing=1"]}, "nothing"),
        ({"gnss_outages": ["5"]}, "60:90"),
    ],
)
def test_what_cannot_be_is_refused_by_name(told: dict, words: str) -> None:
    with pytest.raises(ReplayError, match=words):
        options_from_text(**told)


def test_somebody_elses_folder_is_left_alone(short: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ReplayError, match="--overwrite"):
        compare_command(short, options_from_text(lanes="vqf"), out=tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == ["thesis.txt"]
    compare_command(short, options_from_text(lanes="vqf"), out=tmp_path, overwrite=True)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["compare.json", "report.html", "thesis.txt"]
    compare_command(short, options_from_text(lanes="vqf"), out=tmp_path)  # an earlier result is replaced


def test_a_log_without_anything_is_compared_without_figures(tmp_path: Path) -> None:
    (tmp_path / "mag.csv").write_text("t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n1000000,0.2,0.0,0.4\n")
    found = compare_log(tmp_path, options_from_text()).out
    assert found.reference is None
    assert all(lane.windows["whole"].rows == 0 for lane in found.lanes.values())
    assert len(found.notes) > len(LANES)


def test_the_whole_table_is_shown(short: Path) -> None:
    text = compare_command(short, options_from_text(lanes="ins_ekf,altitude_kalman"))
    for word in (
        "ins_ekf",
        "altitude_kalman",
        "onboard",
        "Error against reference",
        "Difference to ins_ekf",
        "ns/step",
    ):
        assert (word in text) == (word != "onboard")
    assert not any(line != line.rstrip() for line in text.splitlines())


def test_a_second_power_up_has_lanes_of_its_own(shared_data: Path, tmp_path: Path) -> None:
    recorded = shared_data / "ardupilot_sitl"
    parts = [cut_log(recorded / name, tmp_path / name, 1.0).read_bytes() for name in ("mission.tlog", "static.tlog")]
    (tmp_path / "two.tlog").write_bytes(b"".join(parts))
    found = compare_log(tmp_path / "two.tlog", options_from_text(lanes="ins_ekf,vqf"), with_cost=False).out
    assert set(found.lanes) == {f"{lane}{boot}" for lane in ("ins_ekf", "vqf", "reference") for boot in ("", ".boot1")}
    assert found.lanes["vqf.boot1"].windows["whole"].rows > 100
    assert main_window(found) == "whole"  # neither lasts 30 s beyond its first fix
