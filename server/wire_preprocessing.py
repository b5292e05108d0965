"""Bodies about preprocessing: what each sensor's chain does, and the magnetometer that learns in flight."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, RootModel

from server.wire_base import In, Num, Out
from server.wire_lanes import ParameterOut

ChainSensor = Literal["gyro", "accel", "mag", "baro", "airspeed"]
ChainValue = Annotated[float, Field(strict=True, allow_inf_nan=False)]
ChainName = Annotated[str, Field(min_length=1, max_length=80)]


class ChainOut(Out):
    """The preprocessing chain of one sensor."""

    sensor: ChainSensor
    active: bool = Field(description="false = samples go through as they are")
    delay_s: float = Field(description="by how much its filters are late; the estimators are told")
    parameters: tuple[ParameterOut, ...]
    columns: tuple[str, ...] = Field(description="of the topic stages/<sensor>")


class PreprocessingOut(Out):
    """The chains of a board."""

    board_id: str
    sensors: tuple[ChainOut, ...]


class ChainIn(RootModel[dict[ChainName, ChainValue | None]]):
    """Values by name, null = back to the default; what is not named stays, and nothing is changed if one is refused."""

    model_config = ConfigDict(frozen=True)
    root: dict[ChainName, ChainValue | None] = Field(min_length=1, max_length=32)


class MagLearnOut(Out):
    """What the magnetometer has learned in flight."""

    t_ns: int
    offset_gauss: tuple[Num, ...] = Field(description="centre, subtracted; body FRD, beside the calibration in force")
    sigma_gauss: tuple[Num, ...]
    excitation: tuple[Num, ...] = Field(description="per axis, 0 = never turned, 1 = enough")
    converged: bool
    frozen: bool
    reason: str = Field(description='why it does not learn now: "rest", "room", "few-turns"; "" when it learns')
    changes: int = Field(description="how often the offset changed with the body: a magnet put on or taken off")
    residual_gauss: Num
    ekf_offset_gauss: tuple[Num, ...] = Field(description="the main lane's own magnetic bias; [] when it has none")
    ekf_sigma_gauss: tuple[Num, ...]


class MagLearningOut(Out):
    """The switches of in-flight magnetometer learning and what it found."""

    board_id: str
    run: bool
    apply: bool = Field(description="subtract what was learned from the field that the estimators are given")
    state: MagLearnOut | None = Field(description="null before the first magnetic sample while it runs")


class MagLearningIn(In):
    """Switches; what is left out stays."""

    run: bool | None = None
    apply: bool | None = None
