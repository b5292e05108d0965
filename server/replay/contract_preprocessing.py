"""The preprocessing's part of `summary.json`: calibration in force, stages, magnetic offset learned in flight."""

from __future__ import annotations

from pydantic import Field

from server.replay.contract_base import Out

Numbers = float | list[float] | list[list[float]]


class CalibrationOut(Out):
    """One sensor's calibration as a file gave it; of several for a sensor the last is in force."""

    file: str = Field(description="its name, without the folder")
    sensor: str = Field(description='"gyro", "accel", "mag", "board", "airspeed" or "baro"')
    kind: str = Field(description='kind of calibration, or "import"')
    set_id: str = Field(description='in the store it was exported from; "" for a result of navdeck calibrate')
    parameters: dict[str, Numbers] = Field(
        description="calibrated = matrix · (raw − offset); gyro: scale * (raw − bias); rad/s, m/s², gauss, Pa, m"
    )


class StagesOut(Out):
    """One sensor's way through the preprocessing in one power-up: its file."""

    file: str
    sensor: str
    boot_id: int
    rows: int = Field(description="one a believed sample")
    delay_s: float = Field(description="what its filters delay: a filtered row was valid at t_ns - delay_s")


class LearnedOut(Out):
    """What was learned of the magnetic offset, body FRD, on top of the calibration in force."""

    t_ns: int = Field(description="newest navigation step")
    offset_gauss: list[float] = Field(description="calibrated = (as given) - offset")
    sigma_gauss: list[float] = Field(description="one standard deviation of each axis")
    excitation: list[float] = Field(description="0 = never turned across this axis, 1 = enough")
    converged: bool
    frozen: bool = Field(description="nothing is learned at present")
    reason: str = Field(description='why it is frozen: "rest", "room", "few-turns"; "" when it learns')
    changes: int = Field(description="offsets that were given up for another: a magnet put on or taken off")
    t_changed_ns: int | None = Field(description="when the last of them began; null = never")
    residual_gauss: float | None = Field(description="RMS of what the field's strength varies by; null = not turned")
    applied_gauss: list[float] = Field(description="offset that the estimators' field has been freed of")


class LearningFileOut(Out):
    """Learning in one power-up: its file, and the state at its end (null = no navigation step)."""

    file: str
    boot_id: int
    rows: int
    state: LearnedOut | None


class MagLearningOut(Out):
    """Learning the magnetic offset in flight."""

    run: bool
    apply: bool = Field(description="what was learned was taken off the field that the estimators are given")
    state: LearnedOut | None = Field(description="at the end of the last power-up; null = no navigation step")
    power_ups: list[LearningFileOut]
