"""Asking the board for its messages: one command at a time, because its answer does not say what it answers.

`REQUESTS` is the one table of what is asked for. Each request walks down its ladder of intervals as the board refuses;
a board that answers no command at all, or does not know it, is asked the old way (REQUEST_DATA_STREAM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from server.protocol.base import RequestStats
from server.protocol.mavlink.encode import Encoder


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One message to ask for.

    Attributes:
        intervals_us: the ladder, quickest first.
        slowest_us: on a slow link the first step is slowed down to this at most; 0 = it is left out there.
        frame_bytes: of a full frame, header and check sum included.
    """

    name: str
    message_id: int
    intervals_us: tuple[int, ...]
    slowest_us: int
    frame_bytes: int


def _request(name: str, message_id: int, intervals_ms: tuple[int, ...], slowest_ms: int, frame_bytes: int) -> Request:
    return Request(
        name=name,
        message_id=message_id,
        intervals_us=tuple(1000 * item for item in intervals_ms),
        slowest_us=1000 * slowest_ms,
        frame_bytes=frame_bytes,
    )


REQUESTS: Final[tuple[Request, ...]] = (
    # ArduPilot refuses intervals under 3 ms; the ladder ends where an attitude filter stops being useful.
    _request("HIGHRES_IMU", 105, (3, 5, 10, 20), 50, 74),
    # The board's own attitude, for the lane `onboard`, and the stamp of SIM_STATE.
    _request("ATTITUDE_QUATERNION", 31, (10, 20, 50, 100), 200, 44),
    # Twice the rate of the receiver, so that a new fix is seen at most 100 ms late; never slower than a receiver.
    _request("GPS_RAW_INT", 24, (100, 200, 500, 1000), 200, 64),
    _request("GLOBAL_POSITION_INT", 33, (20, 100, 200), 1000, 40),
    # Differential pressure, and baro where HIGHRES_IMU is refused; the sensors change at 10 Hz.
    _request("SCALED_PRESSURE", 29, (50, 100, 200), 500, 28),
    # The truth of a simulated board; a real one refuses it, which is no fault, and slow links are real.
    _request("SIM_STATE", 108, (10, 20, 100), 0, 104),
    _request("SYSTEM_TIME", 2, (1000,), 5000, 24),
    _request("SYS_STATUS", 1, (1000,), 2000, 43),
)

DATA_STREAMS: Final = ((1, 50), (10, 50), (6, 10), (2, 2), (12, 2))
"""REQUEST_DATA_STREAM, (stream, Hz): raw sensors, attitude, position, extended status, extra 3 (SYSTEM_TIME)."""

TROUBLES: Final = {
    "interval-refused": (
        "The board refuses every rate of HIGHRES_IMU; it was asked the old way, for groups of messages.",
        "Nothing to do if IMU data arrive. Otherwise set the stream rates on the board (ArduPilot: SRn_RAW_SENS = 50).",
    ),
    "interval-unanswered": (
        "The board answers no command on this port; it was asked the old way for groups of messages.",
        "Check that the board's receive line is connected, and that this port takes commands "
        "(ArduPilot: SERIALn_OPTIONS). Otherwise set the stream rates on the board (ArduPilot: SRn_RAW_SENS = 50).",
    ),
}
"""Code of `StreamRequests.code` → cause and remedy."""

TIMEOUT_NS: Final = 700_000_000
TRIES: Final = 4
RETRY_AFTER_NS: Final = 4_000_000_000
"""A board that did not answer, or was not ready (it boots), is asked again after this."""
MISSING_AFTER_NS: Final = 5_000_000_000
"""HIGHRES_IMU was granted and does not come: the board restarted or forgot; ask for everything again."""
LINK_SHARE: Final = 0.7
"""Part of a link's capacity that the requests may fill; the rest is for what the board sends on its own."""

MAX_SLOWDOWN: Final = 100.0

ACCEPTED, TEMPORARILY_REJECTED, UNSUPPORTED, IN_PROGRESS = 0, 1, 3, 5


def needed_bytes_per_s(requests: tuple[Request, ...]) -> float:
    """Return what the first steps of these requests fill."""
    return sum(item.frame_bytes * 1e6 / item.intervals_us[0] for item in requests)


def requests_for(bytes_per_s: float) -> tuple[Request, ...]:
    """Return `REQUESTS`, slowed down together, each to its own limit, until they fit a link of this capacity."""
    slower, factor = REQUESTS, 1.0
    while needed_bytes_per_s(slower) > LINK_SHARE * bytes_per_s and factor < MAX_SLOWDOWN:
        factor *= 1.1
        slower = tuple(_slower(item, factor) for item in REQUESTS if item.slowest_us)
    return slower


def _slower(item: Request, factor: float) -> Request:
    whole_ms = math.ceil(item.intervals_us[0] * factor / 1000) * 1000
    first = min(whole_ms, item.slowest_us)
    return replace(item, intervals_us=(first, *(value for value in item.intervals_us[1:] if value > first)))


class StreamRequests:
    """Drives the requests by answers and time-outs; knows no port and no clock of its own."""

    def __init__(self, encoder: Encoder, requests: tuple[Request, ...] = REQUESTS) -> None:
        self._encoder = encoder
        self._requests = requests
        self.code = ""
        """Key of `TROUBLES`, "" = as asked: what became of the first request, the IMU; kept while asking again."""
        self.restart()

    def restart(self) -> None:
        """Ask for everything again: the link or the board came back."""
        self._states = ["waiting"] * len(self._requests)
        self._steps = [0] * len(self._requests)
        self._current = 0
        self._tries = 0
        self._asked_ns = -1
        self._answered = False
        self._streams_left = 0
        self._streams_ns = -1
        self._finished_ns = -1
        self._frames = -1
        self._frames_ns = -1

    @property
    def stats(self) -> tuple[RequestStats, ...]:
        """What was asked for and what became of it."""
        return tuple(
            RequestStats(
                message=item.name,
                state=state,
                wanted_hz=1e6 / item.intervals_us[0],
                granted_hz=1e6 / item.intervals_us[step] if state == "granted" else float("nan"),
            )
            for item, state, step in zip(self._requests, self._states, self._steps, strict=True)
        )

    def outgoing(self, now_ns: int, system: int, component: int, imu_frames: int) -> bytes:
        """Return what is to be sent now to this board, of which `imu_frames` HIGHRES_IMU have come so far."""
        if imu_frames != self._frames or self._frames_ns < 0:
            self._frames, self._frames_ns = imu_frames, now_ns
        if self._states[0] == "granted" and now_ns - self._frames_ns > MISSING_AFTER_NS:
            self.restart()
        return self._ask(now_ns, system, component) + self._ask_streams(now_ns, system, component)

    def on_ack(self, command: int, result: int) -> None:
        """Take a COMMAND_ACK that may be ours."""
        if command != 511 or self._asked_ns < 0 or self._current >= len(self._requests) or result == IN_PROGRESS:
            return
        self._answered = True
        k = self._current
        if result == ACCEPTED:
            self._next("granted")
        elif result == TEMPORARILY_REJECTED:
            return  # the time-out asks again
        elif result == UNSUPPORTED:
            self._end_all("refused", k)
        elif self._steps[k] + 1 < len(self._requests[k].intervals_us):
            self._steps[k] += 1
            self._tries = 0
            self._asked_ns = -1
        else:
            self._next("refused")

    def _ask(self, now_ns: int, system: int, component: int) -> bytes:
        if self._current >= len(self._requests):
            return self._ask_later(now_ns)
        if self._asked_ns >= 0 and now_ns - self._asked_ns < TIMEOUT_NS:
            return b""
        if self._tries >= TRIES:
            self._give_up()
            return b""
        self._tries += 1
        self._asked_ns = now_ns
        k = self._current
        item = self._requests[k]
        self._states[k] = "asked"
        interval_us = item.intervals_us[self._steps[k]]
        return self._encoder.set_message_interval(system, component, item.message_id, interval_us)

    def _ask_later(self, now_ns: int) -> bytes:
        if "unanswered" in self._states:
            if self._finished_ns < 0:
                self._finished_ns = now_ns
            elif now_ns - self._finished_ns > RETRY_AFTER_NS:
                self.restart()
        return b""

    def _give_up(self) -> None:
        if self._answered:
            self._next("unanswered")
            return
        self._end_all("unanswered", 0)

    def _end_all(self, state: str, first: int) -> None:
        self._states[first:] = [state] * (len(self._states) - first)
        self._current = len(self._requests)
        self._judge_imu()

    def _next(self, state: str) -> None:
        self._states[self._current] = state
        if self._current == 0:
            self._judge_imu()
        self._current += 1
        self._tries = 0
        self._asked_ns = -1

    def _judge_imu(self) -> None:
        state = self._states[0]
        self.code = "" if state == "granted" else f"interval-{state}"
        self._streams_left = 0 if state == "granted" else 3
        self._streams_ns = -1

    def _ask_streams(self, now_ns: int, system: int, component: int) -> bytes:
        due = self._streams_ns < 0 or now_ns - self._streams_ns >= 2_000_000_000
        if not self._streams_left or not due:
            return b""
        self._streams_left -= 1
        self._streams_ns = now_ns
        ask = self._encoder.request_data_stream
        return b"".join(ask(system, component, stream, rate_hz) for stream, rate_hz in DATA_STREAMS)
