"""Bodies that say whether errors are as large as the filter's own σ (`server.nav.consistency`)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from server.wire_base import Num, Out

ConsistencyVerdict = Literal["over-confident", "conservative", "consistent", "too-few"]


class ConsistencyOut(Out):
    """One windowed chi-square test of the main lane's state errors against the reference, or of the lane as a whole."""

    lane: str
    group: Literal["attitude", "velocity", "position", "lane"] = Field(
        description='"lane" is the verdict over state errors and innovations together: the worst of them'
    )
    mean: Num = Field(description="squared error over published variance, mean per component; 1 = consistent")
    low: Num = Field(description="two-sided 95 % chi-square bound of the mean, autocorrelation taken into account")
    high: Num
    samples: int = Field(description="epochs in the window of the last minute")
    effective: float = Field(description="independent squared components that they are worth")
    verdict: ConsistencyVerdict
    reason: str = Field(description='what decided; "" when nothing speaks against it')
