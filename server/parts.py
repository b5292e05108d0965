"""How the parts of a board are made: the only place that knows every kind of link, protocol and engine."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol
from urllib.parse import parse_qs

from server.board import BoardParts, Engine
from server.boards import split_link
from server.commands import AddBoard
from server.nav.types import EngineSettings

if TYPE_CHECKING:
    from server.link.base import Link
    from server.protocol.base import BoardProtocol
    from server.traffic import Finding

KERNEL_MODULES: Final = ("server.nav.engine", "server.protocol.mavlink")
"""Importing these loads every kernel of the live path."""


class Factories(Protocol):
    """What `app` builds boards from; tests have their own."""

    def load(self) -> None:
        """Load every kernel, which takes about a second; `ValueError` for settings the engine does not take."""
        ...

    def parts(self, command: AddBoard, observe_latency: Callable[[float], None]) -> BoardParts:
        """Return how to make the parts of the board that this command asks for."""
        ...


class RealFactories:
    """The links, protocols and the engine of this package."""

    def __init__(self, engine: EngineSettings, *, talk: bool) -> None:
        self._engine = engine
        self._talk = talk

    def load(self) -> None:
        """Load every kernel, so that the stream never waits for the compiler; `ValueError` for an unknown lane."""
        for name in KERNEL_MODULES:
            importlib.import_module(name)
        self._new_engine()

    def parts(self, command: AddBoard, observe_latency: Callable[[float], None]) -> BoardParts:
        """Return how to make the parts of the board that this command asks for."""
        from server.link import open_link

        def link() -> Link:
            return open_link(command.url)

        def protocol() -> BoardProtocol:
            from server.protocol.mavlink import MavlinkProtocol

            talk = self._talk and split_link(command.url)[0] != "file"  # nobody answers in a recording
            return MavlinkProtocol(command.system, command.component, talk)

        return BoardParts(
            link=link, protocol=protocol, engine=self._new_engine, detect=detect, observe_latency=observe_latency
        )

    def _new_engine(self) -> Engine:
        from server.magnetic import wmm_field
        from server.nav.engine import NavEngine

        return NavEngine(self._engine, wmm_field)


def detect(data: bytes, url: str) -> Finding | None:
    """Say what bytes are that make no MAVLink frame; None while they are too few."""
    from server.protocol.detect import detect as found_in
    from server.traffic import Finding

    scheme, _ = split_link(url)
    baud = parse_qs(url.partition("?")[2]).get("baud", [""])[0]
    found = found_in(data, int(baud) if scheme == "serial" and baud.isdigit() else None)
    if found is None:
        return None
    details = {"protocol": found.protocol, "baud": baud}
    return Finding(found.state, found.code, found.cause, found.remedy, {k: v for k, v in details.items() if v})
