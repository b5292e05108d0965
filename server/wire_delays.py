"""Bodies that say how late each measurement is, and how that is known."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from server.wire_base import Num, Out

DelayedName = Literal["imu", "gnss_position", "gnss_velocity", "mag", "baro"]


class DelayOut(Out):
    """The delay of one measurement: told, estimated on line from the innovations of `ins_ekf`, or unknown."""

    measurement: DelayedName
    delay_s: Num = Field(
        default=None, description="a sample stamped t is valid at t − delay; null = nobody knows, none is assumed"
    )
    sigma_s: Num = Field(
        default=None, description="standard deviation of an estimate, which is used once it is below 0.05; else null"
    )
    filter_s: Num = Field(default=None, description="what our own filters add to it; null = none is on")
    source: Literal["settings", "board", "estimated", "unknown"] = Field(
        description='"settings": a person said so; "board": known of this kind of board; "estimated": from innovations'
    )
