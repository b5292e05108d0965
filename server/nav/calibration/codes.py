"""Why a calibration may refuse: one list, shared by the command line, REST and the page."""

from __future__ import annotations

from typing import Final

from server.nav.calibration.types import Failure

FAILURES: Final[dict[str, str]] = {
    "no-data": "No sample of this sensor arrived. Check that the board sends it.",
    "too-few-samples": "There were too few samples. Collect for longer.",
    "too-few-poses": "There were too few still poses. Take more, each in another direction, and hold each still.",
    "pose-missing": "Not every one of the six faces was taken. Take the ones that miss.",
    "poses-alike": "The poses are too much alike. Spread them over all directions.",
    "motion": "The board moved. Put it on something solid and leave it alone.",
    "coverage-planar": "All directions lie near one plane or one cone. Turn the board about a second and a third axis.",
    "coverage-poor": "Too much of the sphere was never measured. Turn every side of the board up, down and around.",
    "field-strength": "The field's strength is not the Earth's here. Move away from iron, motors and cables.",
    "field-uneven": "The field changed from place to place. Go away from iron; turn the board on one spot.",
    "field-unknown": "The Earth's field here is not known. Wait for a position, or give one in the settings.",
    "heading-unknown": "The true heading is needed. Give it in degrees from true north.",
    "saturated": "The sensor ran into its range. Choose a wider range, or move slower, away from magnets.",
    "residual": "The samples do not fit the model. Take away what disturbs, and collect again.",
    "gravity": "At rest the length is not gravity's. Check the unit and the range of the accelerometer.",
    "not-turned": "The board hardly turned about this axis. Turn it by whole turns, then hold it still.",
    "turns-mismatch": "The measured angle is far from that many turns. Count the turns again, or give another number.",
    "axis-mismatch": "Most of the turning was about another axis. Put that axis upright, or name the other one.",
    "tilt": "The board is tilted too much for this. Set it up level first.",
    "airflow": "The pressure is not steady. Cover the pitot tube, out of the wind.",
    "out-of-range": "The measured value is outside what is physically possible. Check the sensor and its unit.",
    "not-settled": "The estimate has not settled. Let the vehicle turn more, about more than one axis.",
    "timed-out": "It was not finished in time. Start again; what was collected is kept as a file.",
    "board-removed": "The board was removed while it was being calibrated.",
    "program": "The calibration itself failed. Please report this with the log.",
}
"""Code → English sentence and advice. A new code needs its translation on the page."""


def failure(code: str, measured: float = float("nan"), limit: float = float("nan"), unit: str = "") -> Failure:
    """Return the failure of this code; `KeyError` for a code that is not in the list."""
    return Failure(code=code, measured=float(measured), limit=float(limit), unit=unit, advice=FAILURES[code])


def outside(code: str, measured: float, low: float, high: float, unit: str) -> Failure | None:
    """Return the failure of a number beyond one of two limits in `unit`, with that limit; None within, and for NaN."""
    if measured < low:
        return failure(code, measured, low, unit)
    return failure(code, measured, high, unit) if measured > high else None
