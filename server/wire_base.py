"""What every body on the wire has in common: null for unknown, and the one error body."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Severity = Literal["ok", "info", "caution", "warning"]
Role = Literal["viewer", "operator"]


def _none_from_nan(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Num = Annotated[float | None, BeforeValidator(_none_from_nan)]
"""A number, or null when unknown."""


class Out(BaseModel):
    """Base of everything the server sends; fields with a default are always present."""

    model_config = ConfigDict(frozen=True, json_schema_serialization_defaults_required=True)


class In(BaseModel):
    """Base of everything a client sends; an unknown key is an error, not a silent no-op."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ProblemError(Out):
    """One offending value of a request."""

    name: str
    value: str
    detail: str


class Problem(Out):
    """The one error body (RFC 9457, application/problem+json) of every status of 400 and above."""

    type: str = Field(description="urn:navdeck:problem:<code>")
    title: str
    status: int
    detail: str = Field(description="what happened, in one English sentence")
    code: str = Field(description="stable kebab-case key; the page translates it")
    remedy: str = Field(default="", description="what to do about it")
    errors: tuple[ProblemError, ...] = ()
