"""`navdeck compare --five-motions`: S4's table and S3's comparison."""

import json
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from server.compare.command import Told, five_motions_command, run
from server.compare.contract import FiveMotionsOut
from server.compare.motions import ALTITUDE, calmed
from server.compare.schemas import shipped
from server.nav.types import Kind
from server.replay.errors import ReplayError
from server.sim.motions import MOTIONS, motion
from tests.compare.test_report import outline

LANES = "ins_ekf,complementary_1,dmp,altitude_complementary,altitude_inertial,altitude_kalman"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "five"
    text = five_motions_command(lanes=LANES, out=out)
    assert "slow tilt" in text
    return out


@pytest.fixture(scope="module")
def found(folder: Path) -> FiveMotionsOut:
    return FiveMotionsOut.model_validate_json((folder / "five_motions.json").read_bytes())


def test_the_json_fits_its_schema(folder: Path) -> None:
    schema = Draft202012Validator(shipped("five_motions.schema.json"))
    schema.validate(json.loads((folder / "five_motions.json").read_bytes()))


def test_the_table_is_five_motions_by_every_lane_with_an_attitude(found: FiveMotionsOut) -> None:
    assert [one.motion for one in found.attitude] == [name for name in MOTIONS if name != ALTITUDE]
    for one in found.attitude:
        for lane in ("ins_ekf", "complementary_1", "dmp"):
            assert one.lanes[lane].roll_rad.rms > 0.0
            assert one.lanes[lane].pitch_rad.rms > 0.0
            assert one.lanes[lane].cost.ns_per_step > 0.0
        assert one.lanes["dmp"].heading_rad is None
        assert one.lanes["altitude_kalman"].roll_rad is None


def test_translation_fools_the_simplest_filter_more_than_the_main_lane(found: FiveMotionsOut) -> None:
    (moved,) = (one for one in found.attitude if one.motion == "translation")
    assert moved.lanes["complementary_1"].pitch_rad.max > 3.0 * moved.lanes["ins_ekf"].pitch_rad.max


def test_a_misled_barometer_costs_every_height_and_the_blend_most(found: FiveMotionsOut) -> None:
    calm, misled = found.altitude
    assert (calm.baro_disturbance_m, misled.baro_disturbance_m) == (0.0, 5.0)
    for lane in ("altitude_complementary", "altitude_inertial", "altitude_kalman"):
        assert misled.lanes[lane].height_m.rms > 2.0 * calm.lanes[lane].height_m.rms
    worst = {lane: misled.lanes[lane].height_m.max for lane in misled.lanes if lane.startswith("altitude_")}
    assert max(worst, key=worst.__getitem__) == "altitude_complementary"
    assert misled.lanes["altitude_kalman"].vertical_m_s.rms < misled.lanes["altitude_complementary"].vertical_m_s.rms


def test_calm_air_changes_the_barometer_alone() -> None:
    flown, calm = motion(ALTITUDE), calmed(motion(ALTITUDE))
    largest = 0.0
    for one, other in zip(flown, calm, strict=True):
        baro = one.kind == Kind.BARO
        assert np.array_equal(one.data[~baro], other.data[~baro], equal_nan=True)
        difference_m = one.data[baro, 1] - other.data[baro, 1]
        largest = max(largest, float(difference_m.max()))
        told = difference_m > 0.1
        ratio = one.data[baro, 0][told] / other.data[baro, 0][told]
        assert np.allclose(-difference_m[told] / np.log(ratio), 8000.0, rtol=0.06)  # p falls by 1/e in about 8 km
    assert largest == pytest.approx(5.0, abs=0.1)


def test_the_page_is_whole_and_self_contained(folder: Path) -> None:
    html = (folder / "report.html").read_text(encoding="utf-8")
    outline(html)
    assert "://" not in html
    assert "Slow tilt" in html
    assert "baro misled by 5 m" in html


def told(**changed: object) -> Told:
    nothing = {
        "log": None, "five_motions": False, "lanes": "all", "chosen": "ins_ekf", "reference": None, "parameters": (),
        "gnss_outages": (), "windows": (), "nav_rate_hz": None, "seed": None, "out": None, "overwrite": False,
        "as_json": False,
    }  # fmt: skip
    return Told(**{**nothing, **changed})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "--five-motions"),
        ({"five_motions": True, "log": Path("flight.tlog")}, "flight.tlog"),
        ({"five_motions": True, "windows": ("1:2",)}, "--window"),
        ({"five_motions": True, "seed": -1}, "-1"),
        ({"log": Path("flight.tlog"), "seed": 3}, "--seed"),
        ({"log": Path("flight.tlog")}, "does not exist"),
    ],
)
def test_options_that_contradict_each_other_are_refused(changed: dict, words: str) -> None:
    with pytest.raises(ReplayError, match=words):
        run(told(**changed))
