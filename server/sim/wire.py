"""MAVLink 2 framing for the demo board: payload in, frame out; and what the ground asks of it.

Layouts and check bytes come from pymavlink's definitions; its encoder objects, at 20 µs a message, do not.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

SYSTEM: Final = 1
COMPONENT: Final = 1
ACCEPTED: Final = 0
DENIED: Final = 2
UNSUPPORTED: Final = 3
SET_MESSAGE_INTERVAL: Final = int(dialect.MAV_CMD_SET_MESSAGE_INTERVAL)


class Message:
    """Packs one kind of message; the order of values is the wire's (largest types first)."""

    def __init__(self, definition: Any) -> None:  # noqa: ANN401  (pymavlink has no types)
        self.id = int(definition.id)
        self.extra = bytes([definition.crc_extra])
        self._pack = definition.unpacker.pack

    def payload(self, *values: Any) -> bytes:  # noqa: ANN401  (numbers and texts, as the kind has them)
        """Return the payload without its trailing zeros, at least one byte."""
        packed: bytes = self._pack(*values)
        return packed.rstrip(b"\0") or b"\0"


HEARTBEAT: Final = Message(dialect.MAVLink_heartbeat_message)
SYS_STATUS: Final = Message(dialect.MAVLink_sys_status_message)
SYSTEM_TIME: Final = Message(dialect.MAVLink_system_time_message)
GPS_RAW_INT: Final = Message(dialect.MAVLink_gps_raw_int_message)
SCALED_PRESSURE: Final = Message(dialect.MAVLink_scaled_pressure_message)
ATTITUDE_QUATERNION: Final = Message(dialect.MAVLink_attitude_quaternion_message)
GLOBAL_POSITION_INT: Final = Message(dialect.MAVLink_global_position_int_message)
HIGHRES_IMU: Final = Message(dialect.MAVLink_highres_imu_message)
SIM_STATE: Final = Message(dialect.MAVLink_sim_state_message)
STATUSTEXT: Final = Message(dialect.MAVLink_statustext_message)
COMMAND_ACK: Final = Message(dialect.MAVLink_command_ack_message)
TIMESYNC: Final = Message(dialect.MAVLink_timesync_message)


class Framer:
    """Gives frames their sequence numbers."""

    def __init__(self) -> None:
        self._sequence = 0

    def frame(self, message: Message, payload: bytes) -> bytes:
        """Return the next frame of the board."""
        head = struct.pack("<BBBBBBHB", len(payload), 0, 0, self._sequence, SYSTEM, COMPONENT, message.id & 0xFFFF, 0)
        self._sequence = (self._sequence + 1) & 0xFF
        check = dialect.x25crc(head + payload + message.extra).crc
        return b"\xfd" + head + payload + struct.pack("<H", check)


@dataclass(frozen=True, slots=True)
class IntervalRequest:
    """The ground wants a message at an interval; 0 or less stops it."""

    message_id: int
    interval_us: float
    asker: tuple[int, int]


@dataclass(frozen=True, slots=True)
class OtherCommand:
    """A command that the demo board does not know."""

    command: int
    asker: tuple[int, int]


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """The ground's half of a TIMESYNC."""

    ts1: int


Request = IntervalRequest | OtherCommand | TimeRequest


class Listener:
    """Finds the requests to this board in what the ground sends; everything else is ignored."""

    def __init__(self) -> None:
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True

    def feed(self, data: bytes) -> list[Request]:
        """Return the requests that `data` completed, oldest first."""
        found = (_request(message) for message in self._parser.parse_buffer(data) or [])
        return [request for request in found if request is not None]


def _request(message: Any) -> Request | None:  # noqa: ANN401  (pymavlink has no types)
    kind = message.get_type()
    asker = (message.get_srcSystem(), message.get_srcComponent())
    if kind == "TIMESYNC" and message.tc1 == 0:
        return TimeRequest(message.ts1)
    if (
        kind != "COMMAND_LONG"
        or message.target_system not in (0, SYSTEM)
        or message.target_component not in (0, COMPONENT)
    ):
        return None
    if message.command == SET_MESSAGE_INTERVAL:
        return IntervalRequest(int(message.param1), message.param2, asker)
    return OtherCommand(message.command, asker)
