"""Bodies about the store of calibration sets: versions, what is in force, comparison, import and export."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from server.wire_base import In, Num, Out
from server.wire_calibration import CheckOut, GradeName, ResidualOut, SensorName, ValueOut

Format = Literal["native", "ardupilot", "px4", "c"]
TEXT_MAX: Final = 120_000  # a whole parameter file; the door lets twice that through


class SetOut(Out):
    """One stored calibration of one sensor."""

    id: str
    board_id: str
    sensor: SensorName
    kind: str
    in_force: bool
    created_utc: str
    created_by: str
    software_version: str
    source: str
    note: str
    grade: GradeName
    coverage: Num
    parameters: dict[str, ValueOut]
    sigma: dict[str, ValueOut]
    residual_before: ResidualOut | None
    residual_after: ResidualOut | None
    temperature_degc: Num
    check: CheckOut | None
    samples_file: str


class SensorSetsOut(Out):
    """What is in force on one sensor."""

    sensor: SensorName
    set_id: str = Field(description='"" = none')
    parameters: dict[str, ValueOut] = Field(description="in force, also where none was applied")
    can_roll_back: bool


class SetsOut(Out):
    """The store of one board, newest first."""

    board_id: str
    sensors: tuple[SensorSetsOut, ...]
    sets: tuple[SetOut, ...]
    troubles: tuple[str, ...] = Field(description="what the store had to put aside when it was opened")


class ChangeOut(Out):
    """One number of a comparison of two sets."""

    name: str
    old: Num
    new: Num
    change: Num
    change_in_sigma: Num


class DiffOut(Out):
    """Two sets of one sensor, number by number."""

    old_id: str
    new_id: str
    changes: tuple[ChangeOut, ...]


class ImportIn(In):
    """A calibration from elsewhere: navdeck's JSON, or a parameter file of ArduPilot or PX4."""

    name: str = Field("a file", min_length=1, max_length=200, description="of the file, for the provenance")
    text: str = Field(min_length=1, max_length=TEXT_MAX)
    board_text: str = Field("", max_length=TEXT_MAX, description="parameter file of what the board applies already")


class WarningOut(Out):
    """What a file cannot say or hold."""

    code: str
    text: str


class ExportIn(In):
    """What is in force, as a file for an autopilot that applies parameters of its own already."""

    format: Format
    board_text: str = Field("", max_length=TEXT_MAX, description="parameter file of what the board applies already")


class ImportedOut(Out):
    """What became of an imported file."""

    format: str
    added: tuple[str, ...] = Field(description="ids of the new sets, none of them in force")
    warnings: tuple[WarningOut, ...]
    store: SetsOut


class SensorIn(In):
    """A sensor named in a request."""

    sensor: SensorName
