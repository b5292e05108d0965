"""Run the kernels once, so that the first byte of a board meets machine code."""

from __future__ import annotations

from server.protocol.mavlink.protocol import MavlinkProtocol


def warm() -> None:
    """Load or compile every kernel and call the two that the live path calls, the encoder's check sum included."""
    protocol = MavlinkProtocol()
    protocol.feed(protocol.outgoing(1), 1)
