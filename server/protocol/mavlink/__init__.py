"""MAVLink 1 and 2, sans-I/O: `MavlinkProtocol` is all that others need; `warm` runs every kernel once."""

from server.protocol.mavlink.protocol import MavlinkProtocol
from server.protocol.mavlink.requests import REQUESTS, Request, requests_for
from server.protocol.mavlink.scanner import FrameScanner
from server.protocol.mavlink.warmup import warm

__all__ = ["REQUESTS", "FrameScanner", "MavlinkProtocol", "Request", "requests_for", "warm"]
