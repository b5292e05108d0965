"""MAVLink 2 frames of our own: heartbeat, commands, time sync."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from server.protocol.mavlink.scanner import CRC_TABLE, MAGIC_V2, crc_x25
from server.protocol.mavlink.table import message_table

OWN_SYSTEM: Final = 254
"""Our system id. Not 255: ArduPilot takes a heartbeat of its ground station's id (255) as a sign that the pilot's
ground station is alive, whatever its type: a display that used it would hold off the ground station failsafe."""
OWN_COMPONENT: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
TYPE_ONBOARD_CONTROLLER: Final = 18
AUTOPILOT_INVALID: Final = 8
STATE_ACTIVE: Final = 4
MAVLINK_VERSION: Final = 3

HEARTBEAT: Final = 0
REQUEST_DATA_STREAM: Final = 66
COMMAND_LONG: Final = 76
TIMESYNC: Final = 111
CMD_SET_MESSAGE_INTERVAL: Final = 511


class Encoder:
    """Build frames with running sequence numbers."""

    def __init__(self, system: int = OWN_SYSTEM, component: int = OWN_COMPONENT) -> None:
        self.system = system
        self.component = component
        self._seq = 0

    def frame(self, message_id: int, payload: bytes) -> bytes:
        """Return a MAVLink 2 frame; trailing zeros of the payload are left out, as the specification asks."""
        payload = payload.rstrip(b"\0") or payload[:1]
        head = bytes((len(payload), 0, 0, self._seq, self.system, self.component)) + message_id.to_bytes(3, "little")
        self._seq = (self._seq + 1) & 255
        table = message_table()
        extra = int(table.crc_extra[table.index_of_id[message_id]])
        body = head + payload
        crc = int(crc_x25(np.frombuffer(bytearray(body), np.uint8), 0, len(body), extra, CRC_TABLE))
        return bytes((MAGIC_V2,)) + body + crc.to_bytes(2, "little")

    def heartbeat(self) -> bytes:
        """Return our heartbeat: an onboard controller, so that nobody takes us for the pilot's ground station."""
        fields = (0, TYPE_ONBOARD_CONTROLLER, AUTOPILOT_INVALID, 0, STATE_ACTIVE, MAVLINK_VERSION)
        return self.frame(HEARTBEAT, struct.pack("<IBBBBB", *fields))

    def set_message_interval(self, system: int, component: int, message_id: int, interval_us: int) -> bytes:
        """Return the command that asks a board for a message at an interval; it answers with COMMAND_ACK."""
        parameters = (float(message_id), float(interval_us), 0.0, 0.0, 0.0, 0.0, 0.0)
        payload = struct.pack("<7fHBBB", *parameters, CMD_SET_MESSAGE_INTERVAL, system, component, 0)
        return self.frame(COMMAND_LONG, payload)

    def request_data_stream(self, system: int, component: int, stream: int, rate_hz: int) -> bytes:
        """Return the old request for a group of messages, which no board answers."""
        return self.frame(REQUEST_DATA_STREAM, struct.pack("<HBBBB", rate_hz, system, component, stream, 1))

    def timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        """Return a TIMESYNC: a question with tc1 = 0, else the answer to the question that carried ts1."""
        return self.frame(TIMESYNC, struct.pack("<qq", tc1_ns, ts1_ns))
