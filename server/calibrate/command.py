"""`navdeck calibrate`: what was told in, the text to print and the exit status out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from server.calibrate.contract import result_json, result_out
from server.calibrate.errors import CalibrateError
from server.calibrate.report import report
from server.calibrate.run import calibrate
from server.calibrate.told import Told

FITTED: Final = 0
REFUSED: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What to print on standard output, and the exit status."""

    text: str
    status: int


def run(told: Told, *, as_json: bool = False, out: Path | None = None) -> Answer:
    """Calibrate from files.

    Args:
        told: the command line.
        as_json: print JSON instead of a table.
        out: write the JSON here too, a refusal as well.

    Raises:
        CalibrateError: a file or an option is not usable; nothing was written.
    """
    found = result_out(calibrate(told))
    text = result_json(found)
    if out is not None:
        _write(out, text + "\n")
    shown = text if as_json else report(found, raw=told.unit == "raw")
    return Answer(text=shown, status=FITTED if found.ok else REFUSED)


def _write(out: Path, text: str) -> None:
    """Put the whole file in place at once."""
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(out)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise CalibrateError(
            f"--out {out} cannot be written: {error.strerror}. Give a file in a folder that is there."
        ) from error
