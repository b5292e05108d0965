"""The JSON Schemas of both sides of a replay, generated from the code that reads and writes."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, cast

from server.nav.types import CSV_LANE_COLUMNS, LANE_COLUMNS, STAGE_COLUMNS
from server.replay.contract import SummaryOut
from server.replay.csv_out import CSV_COLUMNS, STATUS_WORDS
from server.replay.learning import LEARNING_COLUMNS
from server.replay.meta import MetaIn
from server.replay.tables import COLUMN_MEANING, T_NS, TABLES, Table

DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]

_LANE_MEANING: Final = {
    T_NS: "board time the row is valid at, ns; a .tlog's is the board's boot time",
    "sigma_att_x_rad": "standard deviation of the attitude's error rotation vector in NED about north, rad",
    "sigma_att_y_rad": "the same about east, rad",
    "sigma_att_z_rad": "the same about down: heading, rad",
    "sigma_vel_n_m_s": "standard deviation of the velocity north, m/s",
    "sigma_vel_e_m_s": "standard deviation of the velocity east, m/s",
    "sigma_vel_d_m_s": "standard deviation of the velocity down, m/s",
    "sigma_pos_n_m": "standard deviation of the position north, m",
    "sigma_pos_e_m": "standard deviation of the position east, m",
    "sigma_pos_d_m": "standard deviation of the position down, m",
    "gyro_bias_x_rad_s": "gyro bias about body x, rad/s",
    "gyro_bias_y_rad_s": "gyro bias about body y, rad/s",
    "gyro_bias_z_rad_s": "gyro bias about body z, rad/s",
    "accel_bias_x_m_s2": "accelerometer bias along body x, m/s²",
    "accel_bias_y_m_s2": "accelerometer bias along body y, m/s²",
    "accel_bias_z_m_s2": "accelerometer bias along body z, m/s²",
    "status": "state of the lane",
}


def schemas() -> dict[str, Schema]:
    """Return every schema by its file name."""
    return {
        "sensor-folder.schema.json": _folder_schema(),
        "meta.schema.json": {"$schema": DRAFT, **MetaIn.model_json_schema(by_alias=True)},
        "lane.schema.json": _lane_schema(),
        "stages.schema.json": _stages_schema(),
        "mag-learning.schema.json": _learning_schema(),
        "summary.schema.json": {"$schema": DRAFT, **SummaryOut.model_json_schema(mode="serialization")},
    }


def schema_text(schema: Schema) -> str:
    """Return a schema as it stands in its file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def write_schemas(folder: Path) -> None:
    """Write every schema into the folder; run it after a change: `python -m server.replay.schemas`."""
    for name, schema in schemas().items():
        (folder / name).write_text(schema_text(schema), encoding="utf-8")


@cache
def shipped(name: str) -> Schema:
    """Return a schema as it is shipped in the package."""
    return cast(Schema, json.loads(files("server.replay").joinpath("schema", name).read_text(encoding="utf-8")))


def _stamp() -> Schema:
    return {"type": "integer", "minimum": -(1 << 63), "maximum": (1 << 63) - 1, "description": COLUMN_MEANING[T_NS]}


def _cell(table: Table, name: str) -> Schema:
    if table.integer:
        limits = {"minimum": -(1 << 31), "maximum": (1 << 31) - 1}
        return {"type": ["integer", "null"], **limits, "description": f"{COLUMN_MEANING[name]}, int32 Q30"}
    return {"type": ["number", "null"], "description": COLUMN_MEANING[name]}


def _row_schema(table: Table) -> Schema:
    """Return the schema of one row as an object: header names to cells, an empty cell is null."""
    alone = [group[0] for group in table.needed if len(group) == 1]
    choice = [group for group in table.needed if len(group) > 1]
    schema: Schema = {
        "type": "object",
        "title": table.file,
        "description": f"{table.meaning} One row; columns in any order, found by name, others ignored; empty = null.",
        "properties": {T_NS: _stamp(), **{name: _cell(table, name) for name in table.columns}},
        "required": [T_NS, *alone],
    }
    if choice:
        schema["anyOf"] = [{"required": [name]} for name in choice[0]]
    return schema


def _folder_schema() -> Schema:
    """Return the schema of a sensor folder as an object: file names to rows, meta.toml to its tables."""
    tables = {table.file: {"type": "array", "items": _row_schema(table)} for table in TABLES}
    return {
        "$schema": DRAFT,
        "title": "sensor folder",
        "description": "Input of navdeck replay, body FRD, navigation NED, SI. Any of the CSV files, at least one; "
        "ins_ekf needs imu.csv.",
        "type": "object",
        "properties": {**tables, "meta.toml": {"$ref": "meta.schema.json"}},
        "anyOf": [{"required": [table.file]} for table in TABLES],
    }


def _lane_schema() -> Schema:
    """Return the schema of one row of a lane file; the order of the columns is `x-columns`."""
    meaning = {**COLUMN_MEANING, **_LANE_MEANING}
    columns = LANE_COLUMNS[:CSV_LANE_COLUMNS]
    cells: Schema = {name: {"type": ["number", "null"], "description": meaning[name]} for name in columns}
    cells["status"] = {"enum": list(STATUS_WORDS), "description": meaning["status"]}
    return {
        "$schema": DRAFT,
        "title": "<lane>.csv",
        "description": "Output of navdeck replay: one row a navigation step; unknown = empty = null.",
        "type": "object",
        "properties": {T_NS: {"type": "integer", "description": meaning[T_NS]}, **cells},
        "required": list(CSV_COLUMNS),
        "additionalProperties": False,
        "x-columns": list(CSV_COLUMNS),
    }


def _stages_schema() -> Schema:
    """Return the schema of one row of each sensor's stages; the order of the columns is `x-columns`."""
    return {
        "$schema": DRAFT,
        "title": "<sensor>.stages.csv",
        "description": "Output of navdeck replay where a sensor's chain or calibration is on: sensor to one row of its "
        "file, one row a believed sample; calibrated → limited → filtered, body FRD; unknown = empty = null.",
        "type": "object",
        "properties": {sensor: _number_row((T_NS, *columns)) for sensor, columns in STAGE_COLUMNS.items()},
        "additionalProperties": False,
    }


def _learning_schema() -> Schema:
    """Return the schema of one row of `mag_learning.csv`."""
    row = _number_row(LEARNING_COLUMNS)
    row["properties"] |= {name: {"enum": [0, 1]} for name in ("converged", "frozen")}
    about = (
        "Output of navdeck replay --mag-learning: one row each 0.1 s of board time; calibrated = (as given) - offset."
    )
    return {"$schema": DRAFT, "title": "mag_learning.csv", "description": about, **row}


def _number_row(columns: tuple[str, ...]) -> Schema:
    return {
        "type": "object",
        "properties": {T_NS: {"type": "integer"}, **{name: {"type": ["number", "null"]} for name in columns[1:]}},
        "required": list(columns),
        "additionalProperties": False,
        "x-columns": list(columns),
    }


if __name__ == "__main__":
    write_schemas(Path(__file__).parent / "schema")
