"""Bodies about the estimators of a board: which there are, which run, and what a person may change of them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, RootModel

from server.wire_base import In, Num, Out

LaneStatusName = Literal["aligning", "attitude", "navigating", "dead_reckoning", "failed"]
Provides = Literal["full", "attitude", "altitude"]
LaneName = Annotated[str, Field(min_length=1, max_length=80)]
Value = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class ParameterOut(Out):
    """One number of an estimator that may be changed while it runs."""

    name: str = Field(description="ends in its unit")
    unit: str = Field(description='as shown to people; "" for a pure number')
    default: Num = Field(description="null = the vehicle class's own")
    minimum: float = Field(description="itself allowed")
    maximum: float = Field(description="itself allowed")
    meaning: str = Field(description="what it does and which way to turn it")
    value: Num = Field(description="as it is set; null = the vehicle class's own")


class LaneChoiceOut(Out):
    """One estimator there is, whether it runs or not."""

    name: str
    provides: Provides
    chosen: bool = Field(description="it was asked for")
    running: bool = Field(description="it was asked for and has not failed")
    failure: str = Field(description='why it was put aside; "" when it was not')
    status: LaneStatusName | None = Field(description="its newest; null when it does not run or had no step yet")
    parameters: tuple[ParameterOut, ...]


class LanesOut(Out):
    """Every estimator there is; the first of the chosen ones is the main one."""

    board_id: str
    main_lane: str
    chosen: tuple[str, ...] = Field(description="in the order asked for")
    lanes: tuple[LaneChoiceOut, ...]


class LanesIn(In):
    """The estimators to run from the next step on: those that run go on, new ones start from nothing."""

    lanes: tuple[LaneName, ...] = Field(
        min_length=1, max_length=64, description="each once; the first is the main one; all others are switched off"
    )


class ParametersIn(RootModel[dict[LaneName, Value | None]]):
    """Values by name, null = back to the default; what is not named stays, and nothing is changed if one is refused."""

    model_config = ConfigDict(frozen=True)
    root: dict[LaneName, Value | None] = Field(min_length=1, max_length=64)
