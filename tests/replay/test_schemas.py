"""The shipped JSON Schemas: as generated, and true of a real run's input and output."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError
from referencing import Registry, Resource

from server.replay.run import replay
from server.replay.schemas import schema_text, schemas, shipped
from tests.replay.sensor_folders import OUTPUT_HEADER, read_csv, static_board

INTEGERS = {"t_ns"}


def validator(name: str) -> Draft202012Validator:
    meta = Resource.from_contents(shipped("meta.schema.json"))
    return Draft202012Validator(shipped(name), registry=Registry().with_resource("meta.schema.json", meta))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return static_board(tmp_path_factory.mktemp("log"), duration_s=12.0, imu_hz=100.0)


@pytest.fixture(scope="module")
def out(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("out")
    replay(folder, place, gnss_outages=[(5.0, 6.0)])
    return place


def rows(path: Path) -> list[dict[str, object]]:
    """Read a CSV as the schema sees it: named cells, empty = null."""
    header, lines = read_csv(path)
    return [{name: _cell(name, text) for name, text in zip(header, line, strict=True)} for line in lines]


def _cell(name: str, text: str) -> object:
    if not text:
        return None
    return text if name == "status" else int(text) if name in INTEGERS else float(text)


@pytest.mark.parametrize("name", sorted(schemas()))
def test_the_shipped_schema_is_the_generated_one_and_a_valid_schema(name: str) -> None:
    path = Path(__file__).resolve().parents[2] / "server" / "replay" / "schema" / name
    assert path.read_text(encoding="utf-8") == schema_text(schemas()[name]), "run python -m server.replay.schemas"
    Draft202012Validator.check_schema(shipped(name))


def test_a_real_summary_is_what_its_schema_says(out: Path) -> None:
    validator("summary.schema.json").validate(json.loads((out / "summary.json").read_text(encoding="utf-8")))


def test_a_summary_with_a_stranger_or_without_a_part_is_not(out: Path) -> None:
    found = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    for broken in ({**found, "extra": 1}, {k: v for k, v in found.items() if k != "aids"}):
        with pytest.raises(ValidationError):
            validator("summary.schema.json").validate(broken)


def test_every_row_of_a_lane_is_what_its_schema_says(out: Path) -> None:
    check = validator("lane.schema.json")
    found = rows(out / "ins_ekf.csv")
    assert {row["status"] for row in found} >= {"attitude", "navigating"}
    for row in found[::7]:
        check.validate(row)
    assert shipped("lane.schema.json")["x-columns"] == OUTPUT_HEADER.split(",")
    with pytest.raises(ValidationError):
        check.validate({**found[0], "status": "ok"})


def test_every_row_of_stages_and_learning_is_what_its_schema_says(folder: Path, tmp_path: Path) -> None:
    chain = {"gyro": {"lowpass_hz": 20.0}, "mag": {"window_samples": 2.0}, "baro": {"limit_m": 5.0}}
    replay(folder, tmp_path, lanes=["ins_ekf"], chain=chain, mag_learning="run")
    validator("summary.schema.json").validate(json.loads((tmp_path / "summary.json").read_text(encoding="utf-8")))
    check = validator("stages.schema.json")
    for sensor in ("gyro", "accel", "mag", "baro"):
        found = rows(tmp_path / f"{sensor}.stages.csv")
        for row in found[::7]:
            check.validate({sensor: row})
        assert shipped("stages.schema.json")["properties"][sensor]["x-columns"] == list(found[0])
        with pytest.raises(ValidationError):
            check.validate({sensor: {**found[0], "extra": 1.0}})
    learned = rows(tmp_path / "mag_learning.csv")
    for row in learned:
        validator("mag-learning.schema.json").validate(row)
    with pytest.raises(ValidationError):
        validator("mag-learning.schema.json").validate({**learned[0], "frozen": 2})


def test_a_sensor_folder_is_what_its_schema_says(folder: Path) -> None:
    check = validator("sensor-folder.schema.json")
    given = {path.name: rows(path)[:20] for path in folder.glob("*.csv")}
    given["meta.toml"] = json.loads(json.dumps(tomllib.loads((folder / "meta.toml").read_text()), default=str))
    assert set(given) == {"imu.csv", "mag.csv", "baro.csv", "gnss.csv", "reference.csv", "meta.toml"}
    check.validate(given)
    for broken in (
        {},
        {**given, "imu.csv": [{"t_ns": 1}]},
        {**given, "baro.csv": [{"t_ns": 1}]},
        {**given, "meta.toml": {"gnss": {"delay_ms": 3}}},
        {**given, "dmp.csv": [{"t_ns": 1, "q_w": 0.5, "q_x": 0, "q_y": 0, "q_z": 0}]},
    ):
        with pytest.raises(ValidationError):
            check.validate(broken)
