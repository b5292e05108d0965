"""The JSON Schemas of what `navdeck compare` writes, generated from the models: `python -m server.compare.schemas`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from server.compare.contract import CompareOut, FiveMotionsOut
from server.replay.schemas import DRAFT, schema_text

Schema = dict[str, Any]
FOLDER = Path(__file__).parent / "schema"


def schemas() -> dict[str, Schema]:
    """Return every schema by its file name."""
    return {
        "compare.schema.json": {"$schema": DRAFT, **CompareOut.model_json_schema(mode="serialization")},
        "five_motions.schema.json": {"$schema": DRAFT, **FiveMotionsOut.model_json_schema(mode="serialization")},
    }


def shipped(name: str) -> Schema:
    """Return a schema as it is shipped in the package."""
    found: Schema = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    return found


def write_schemas() -> None:
    """Write every schema into its folder; run it after a change."""
    FOLDER.mkdir(exist_ok=True)
    for name, schema in schemas().items():
        (FOLDER / name).write_text(schema_text(schema), encoding="utf-8")


if __name__ == "__main__":
    write_schemas()
