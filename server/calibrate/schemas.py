"""The JSON Schema of the result, written beside CONTRACT.md: `python -m server.calibrate.schemas`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from server.calibrate.contract import schema_text

NAME: Final = "calibrate.schema.json"


def path() -> Path:
    """Return where it is shipped."""
    return Path(__file__).parent / "schema" / NAME


if __name__ == "__main__":
    path().write_text(schema_text(), encoding="utf-8")
