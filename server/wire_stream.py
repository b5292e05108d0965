"""Messages of the WebSocket `/api/v1/stream`, both ways; binary rows are described in `server.rows`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from server.wire import BoardsOut, EventOut, HealthOut
from server.wire_base import In, Out, Problem


class SubscribeIn(In):
    """Ask for a topic; `id` (chosen by the client) marks every answer. A known id is replaced."""

    op: Literal["subscribe"]
    id: int = Field(ge=1, le=255)
    topic: str = Field(min_length=1, max_length=256)
    rate_hz: float | None = Field(default=None, ge=0.1, le=1000.0, description="null = the topic's own default")


class UnsubscribeIn(In):
    """Stop a subscription; an unknown id is ignored."""

    op: Literal["unsubscribe"]
    id: int = Field(ge=1, le=255)


class PingIn(In):
    """Comes back as it is."""

    op: Literal["ping"]
    t: float


StreamIn = Annotated[SubscribeIn | UnsubscribeIn | PingIn, Field(discriminator="op")]


class SubscribedOut(Out):
    """The subscription stands; rows of a binary topic have these columns after t_ns.

    Comes again, unasked, when the lane of this subscription was switched on.
    """

    op: Literal["subscribed"] = "subscribed"
    id: int
    topic: str
    columns: tuple[str, ...] | None
    rate_hz: float


class StreamErrorOut(Out):
    """A request on the socket that could not be met; the socket stays open. id 0 = no id could be read.

    With the code lane-not-running the subscription waits: it gives rows as soon as that lane is switched on. This also
    comes unasked, when it is switched off.
    """

    op: Literal["error"] = "error"
    id: int
    problem: Problem


class PongOut(Out):
    """Answer to a ping."""

    op: Literal["pong"] = "pong"
    t: float


class TickOut(Out):
    """At least once a second, so that a silent socket is a broken one.

    Attributes:
        t_ns: nanoseconds since this server started.
        lost: messages this client lost to its own slowness, since it connected.
    """

    op: Literal["tick"] = "tick"
    t_ns: int
    lost: int


class DataOut(Out):
    """A message of a JSON topic."""

    op: Literal["data"] = "data"
    id: int
    data: BoardsOut | HealthOut | EventOut
