"""MAVLink as a `BoardProtocol`: bytes of one link in, sample blocks of one board out, and what we have to say to it."""

from __future__ import annotations

import struct
from typing import Final

from server.protocol.base import Decoded, ProtocolStats
from server.protocol.mavlink.board_name import board_name
from server.protocol.mavlink.clock import ClockEstimator
from server.protocol.mavlink.decoder import MavlinkDecoder
from server.protocol.mavlink.encode import OWN_COMPONENT, OWN_SYSTEM, Encoder
from server.protocol.mavlink.layout import (
    COMMAND_ACK,
    HIGHRES_IMU,
    NONE,
    S_AUTOPILOT,
    S_COMPONENT,
    S_FILTERED,
    S_HELD,
    S_REPEATED_IMU,
    S_REPEATED_OTHER,
    S_SYSTEM,
    S_T_LAST,
    S_TYPE,
    STATUSTEXT,
    TIMESYNC,
)
from server.protocol.mavlink.requests import REQUESTS, TROUBLES, StreamRequests, requests_for
from server.protocol.mavlink.scanner import (
    C_CRC_ERRORS,
    C_FRAME_BYTES,
    C_JUNK_BYTES,
    C_TOTAL_FRAMES,
    C_UNKNOWN,
)
from server.protocol.mavlink.texts import TextAssembler

PERIOD_NS: Final = 1_000_000_000
MAX_REPLIES: Final = 4
"""Time sync answers waiting to be sent; older ones are dropped, a late answer is worth nothing."""


class MavlinkProtocol:
    """Decoder and talker of one board over MAVLink 1 or 2.

    The samples depend on the bytes alone. What the host's clock decides is when to send, and `t_rx_ns` of the rows,
    which is the arrival of the chunk that completed the frame: a reader of recordings that feeds chunks of many frames
    makes `t_rx_ns`, and the clock estimate, as coarse as its chunks, and nothing else. A recording that shall give what
    was seen live calls `connected` where the live link did.
    """

    def __init__(
        self,
        system: int | None = None,
        component: int | None = None,
        talk: bool = True,
        bytes_per_s: float | None = None,
    ) -> None:
        """Make a protocol that listens to one sender.

        Args:
            system: MAVLink system id to listen to; None = the first autopilot that sends a heartbeat.
            component: component id to listen to; None = likewise.
            talk: send heartbeats, requests and time sync. False for recordings and for links shared with others.
            bytes_per_s: capacity of the link (a serial line: baud / 10); the requests are slowed down to fit.
        """
        self._decoder = MavlinkDecoder(system, component)
        self._clock = ClockEstimator()
        self._texts = TextAssembler()
        self._encoder = Encoder()
        self._requests = StreamRequests(self._encoder, requests_for(bytes_per_s) if bytes_per_s else REQUESTS)
        self._talk = talk
        self._bytes_in = 0
        self._boot_id = 0
        self._beat_ns = -1
        self._sync_ns = -1
        self._replies: list[int] = []
        self._reply_rx_ns = 0

    def feed(self, data: bytes, t_rx_ns: int) -> Decoded:
        """Take the stream cut anywhere; the samples do not depend on the cuts."""
        self._bytes_in += len(data)
        blocks, others = self._decoder.feed(data, t_rx_ns)
        if self._decoder.boot_id != self._boot_id:
            self._rebooted()
        t_ns = int(self._decoder.ints[S_T_LAST])
        if blocks:
            self._clock.add(t_ns, t_rx_ns)
            self._decoder.rates.update(t_ns)
        texts = self._take_others(others, t_rx_ns) if others else ()
        return Decoded(blocks=blocks, texts=texts)

    def outgoing(self, now_ns: int) -> bytes:
        """Return what should be sent now (heartbeat, stream requests, time sync); empty when nothing is due."""
        if not self._talk:
            return b""
        parts = self._answer_sync()
        system, component = int(self._decoder.ints[S_SYSTEM]), int(self._decoder.ints[S_COMPONENT])
        beat = self._beat_ns < 0 or now_ns - self._beat_ns >= PERIOD_NS
        if beat:
            self._beat_ns = now_ns
            parts.append(self._encoder.heartbeat())
        if system != NONE:
            if beat:
                self._sync_ns = now_ns
                parts.append(self._encoder.timesync(0, now_ns))
            parts.append(self._requests.outgoing(now_ns, system, component, self._decoder.rates.count_of(HIGHRES_IMU)))
        return b"".join(parts)

    def connected(self, now_ns: int) -> None:
        """Forget half a frame and ask for streams again: the link was (re)opened."""
        self._decoder.reconnect()
        self._requests.restart()
        self._beat_ns = -1
        self._replies.clear()

    @property
    def stats(self) -> ProtocolStats:
        """Counters, cheap to read."""
        decoder = self._decoder
        ints, counters = decoder.ints, decoder.scanner.counters
        offset_ns, drift_ppm = self._clock.estimate()
        system = int(ints[S_SYSTEM])
        return ProtocolStats(
            protocol="mavlink",
            bytes_in=self._bytes_in,
            bytes_frames=int(counters[C_FRAME_BYTES]),
            bytes_junk=int(counters[C_JUNK_BYTES]),
            bytes_pending=decoder.scanner.pending,
            frames=int(counters[C_TOTAL_FRAMES] - counters[C_UNKNOWN]),
            crc_errors=int(counters[C_CRC_ERRORS]),
            unknown_messages=int(counters[C_UNKNOWN]),
            filtered_frames=int(ints[S_FILTERED]),
            senders=decoder.senders,
            messages=decoder.rates.table,
            clock_offset_ns=offset_ns,
            clock_drift_ppm=drift_ppm,
            boot_id=decoder.boot_id,
            board=board_name(int(ints[S_AUTOPILOT]), int(ints[S_TYPE]), system) if system != NONE else "",
            repeated_samples=int(ints[S_REPEATED_IMU] + ints[S_REPEATED_OTHER]),
            disbelieved_stamps=int(ints[S_HELD]),
            requests=self._requests.stats if self._talk else (),
            **self._trouble(),
        )

    def _trouble(self) -> dict[str, str]:
        """What is wrong with the requests, as fields of the stats."""
        if not self._talk or not (code := self._requests.code):
            return {}
        cause, remedy = TROUBLES[code]
        return {"code": code, "cause": cause, "remedy": remedy}

    def _rebooted(self) -> None:
        self._boot_id = self._decoder.boot_id
        self._clock.reset()
        self._decoder.rates.reset()
        self._requests.restart()

    def _take_others(self, others: list[tuple[int, bytes]], t_rx_ns: int) -> tuple[tuple[int, str], ...]:
        texts: list[tuple[int, str]] = []
        for message_id, payload in others:
            if message_id == STATUSTEXT:
                texts += self._texts.feed(payload)
            elif message_id == COMMAND_ACK:
                self._take_ack(payload)
            elif message_id == TIMESYNC:
                self._take_sync(payload, t_rx_ns)
        return tuple(texts)

    def _take_ack(self, payload: bytes) -> None:
        command, result, _, _, system, component = struct.unpack("<HBBiBB", payload[:10].ljust(10, b"\0"))
        if (system, component) in ((0, 0), (OWN_SYSTEM, OWN_COMPONENT)):
            self._requests.on_ack(command, result)

    def _take_sync(self, payload: bytes, t_rx_ns: int) -> None:
        tc1_ns, ts1_ns = struct.unpack("<qq", payload[:16].ljust(16, b"\0"))
        if tc1_ns == 0:
            self._reply_rx_ns = t_rx_ns
            self._replies = [*self._replies[1 - MAX_REPLIES :], ts1_ns]
        elif ts1_ns == self._sync_ns:
            self._clock.add_sync(ts1_ns, t_rx_ns, tc1_ns)

    def _answer_sync(self) -> list[bytes]:
        replies = [self._encoder.timesync(self._reply_rx_ns, ts1_ns) for ts1_ns in self._replies]
        self._replies.clear()
        return replies
