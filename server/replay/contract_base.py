"""What every model of `summary.json` has in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Out(BaseModel):
    """A part of the summary: complete, and nothing else in it."""

    model_config = ConfigDict(extra="forbid", frozen=True)
