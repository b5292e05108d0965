"""From what is known of a board to what a person should know: a list of troubles, worst first, each with its remedy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from server.board_view import BoardView
from server.link.base import LinkState
from server.magnetic import WMM_FIRST_YEAR, WMM_LAST_YEAR
from server.nav.types import LANE_COLUMNS, AidHealth, AidStatus, LaneState, LaneStatus, SensorHealth
from server.wire import VerdictOut
from server.wire_base import Severity

WORST_FIRST: Final[dict[str, int]] = {"warning": 0, "caution": 1, "info": 2, "ok": 3}
STALE_S: Final = 1.0
LOST_S: Final = 3.0
AID_STALE_S: Final = 5.0  # slower than the slowest aid (GNSS at 1 Hz) by a margin
LOSS_LIMIT: Final = 0.01
JUNK_LIMIT: Final = 0.01
DRIFT_LIMIT_PPM: Final = 2000.0  # crystals differ by 500 at most; more is a stalling link
IMU_RATE_LOW_HZ: Final = 90.0
SENSOR_STALE_S: Final = {"imu": 1.0, "mag": 3.0, "baro": 3.0, "gnss": 3.0, "airspeed": 3.0}
SENSOR_WORD: Final = {"imu": "IMU", "mag": "magnetometer", "baro": "barometer", "gnss": "GNSS", "airspeed": "airspeed"}
PUT_ASIDE_REMEDY: Final = "Choose it again to restart it, set its parameters back if you changed them, and report this."
STATUS_AT: Final = LANE_COLUMNS.index("status")
DEAD_RECKONING_AT: Final = LANE_COLUMNS.index("dead_reckoning_s")

NOTES: Final[dict[str, tuple[Severity, str, str]]] = {
    "mag-scale-corrected": (
        "info",
        "The board reports the magnetic field in another unit than its protocol says; the scale was found and is used.",
        "Nothing to do; an update of the board's firmware may cure it.",
    ),
    "mag-field-implausible": (
        "caution",
        "The magnetic field fits no known unit and no place on Earth; it is not used.",
        "Move away from iron and currents; calibrate the magnetometer.",
    ),
    "imu-clipped": (
        "caution",
        "The IMU reads the end of its range: what goes beyond it is lost, and the estimate drifts.",
        "Mount it softer, balance the rotors, or choose a wider range on the board.",
    ),
    "imu-stuck": (
        "warning",
        "The IMU repeats one value: it, or the board's driver for it, has stopped.",
        "Restart the board; if it stays, its IMU is broken.",
    ),
    "imu-gaps": (
        "caution",
        "IMU samples are missing; turns within the gaps are not seen.",
        "Lower the other stream rates, or raise the baud rate.",
    ),
}
REASONS: Final[dict[AidStatus, tuple[str, str]]] = {
    AidStatus.REFUSED_GATE: ("it disagrees with the state by more than both allow", "Check that sensor; wait."),
    AidStatus.REFUSED_NO_FIX: ("the receiver has no fix", "Give the antenna a free view of the sky and wait."),
    AidStatus.REFUSED_STALE: ("it arrives too late", "Look at the link's delay and losses."),
    AidStatus.REFUSED_REPEATED: ("the board repeats an old sample", "Check that sensor's wiring on the board."),
    AidStatus.REFUSED_RANGE: ("its values are not physically possible", "Check that sensor and its calibration."),
    AidStatus.REFUSED_DISTURBED: ("the magnetic field is disturbed", "Move away from iron, magnets and currents."),
    AidStatus.REFUSED_ORDER: ("its stamps go backwards", "Check the board's clock and the link."),
}
EXPECTED: Final = frozenset(
    {AidStatus.REFUSED_DISABLED, AidStatus.REFUSED_WITHHELD, AidStatus.REFUSED_NOT_READY, AidStatus.REFUSED_MOVING}
)


def judge(view: BoardView) -> tuple[VerdictOut, ...]:
    """Return every trouble of a board, worst first; empty when all is well."""
    found = [*_board(view), *_link(view)]
    if view.state == "running" and view.link.state is LinkState.OPEN:
        found += [*_traffic(view), *_sensors(view), *_aids(view)]
    found += [*_lanes(view), *_site(view)]
    return tuple(sorted(found, key=lambda line: WORST_FIRST[line.severity]))


def worst(lines: tuple[VerdictOut, ...]) -> Severity:
    """Return the severity of the worst line; ok when there is none."""
    return lines[0].severity if lines else "ok"


def _line(severity: Severity, code: str, subject: str, cause: str, remedy: str, **values: float | None) -> VerdictOut:
    return VerdictOut(severity=severity, code=code, subject=subject, cause=cause, remedy=remedy, values=values)


def _board(view: BoardView) -> Iterator[VerdictOut]:
    if view.state == "failed":
        yield _line("warning", "board-failed", "board", view.cause, view.remedy)


def _link(view: BoardView) -> Iterator[VerdictOut]:
    link = view.link
    if link.state is LinkState.OPENING:
        yield _line("info", link.code or "link-opening", "link", link.cause or "The link is being opened.", link.remedy)
    elif link.state is LinkState.ENDED:
        cause, remedy = link.cause or "The recording is at its end.", link.remedy or "Reconnect to play it again."
        yield _line("info", link.code or "link-ended", "link", cause, remedy)
    elif link.state is not LinkState.OPEN:
        yield _line("warning", link.code or f"link-{link.state}", "link", link.cause, link.remedy)


def _traffic(view: BoardView) -> Iterator[VerdictOut]:
    recent, age_s = view.recent, view.age_s
    if age_s is None and recent.bytes_in and not recent.frames:
        cause = "Bytes arrive but none of them make a message."
        yield _line("warning", "no-frames", "protocol", cause, "Check baud rate and protocol of the port.")
    elif age_s is None and recent.frames:
        cause = "The board talks but sends no sensor data yet."
        yield _line("caution", "no-samples", "protocol", cause, "It was asked for its streams; wait a few seconds.")
    elif age_s is not None and age_s >= STALE_S:
        severity: Severity = "warning" if age_s >= LOST_S else "caution"
        remedy = "Check cable, radio range and the board's power."
        yield _line(severity, "no-data", "link", f"No sensor data for {age_s:.0f} s.", remedy, age_s=age_s)
    loss = recent.lost / max(1, recent.frames + recent.lost)
    if loss > LOSS_LIMIT:
        cause = f"{100 * loss:.1f} % of the messages are lost on the way."
        remedy = "Lower the stream rates, or raise the baud rate; on radio, come closer."
        yield _line("caution", "frames-lost", "protocol", cause, remedy, loss_ratio=loss)
    junk = recent.bytes_junk / max(1, recent.bytes_in)
    if junk > JUNK_LIMIT and recent.frames:
        cause = f"{100 * junk:.1f} % of the bytes are damaged or foreign."
        remedy = "Check the wiring and ground; look for a second program that writes to this link."
        yield _line("caution", "line-noise", "protocol", cause, remedy, junk_ratio=junk)
    if view.stats.code:
        yield _line("caution", view.stats.code, "protocol", view.stats.cause, view.stats.remedy)
    drift_ppm = view.stats.clock_drift_ppm
    if abs(drift_ppm) > DRIFT_LIMIT_PPM:
        cause = f"The board's clock drifts by {drift_ppm:.0f} ppm against this machine's."
        remedy = "Look for a link that stalls, or a virtual machine whose clock does."
        yield _line("caution", "clock-drift", "protocol", cause, remedy, clock_drift_ppm=drift_ppm)


def _sensors(view: BoardView) -> Iterator[VerdictOut]:
    if view.snapshot is None or view.age_s is None or view.age_s >= STALE_S:
        return
    for sensor in view.snapshot.sensors:
        yield from _sensor(view, sensor)


def _sensor(view: BoardView, sensor: SensorHealth) -> Iterator[VerdictOut]:
    word = SENSOR_WORD.get(sensor.name, sensor.name)
    age_s = view.age_of_s(sensor.t_last_ns)
    if sensor.note in NOTES:
        severity, cause, remedy = NOTES[sensor.note]
        yield _line(severity, sensor.note, sensor.name, cause, remedy, scale=sensor.scale)
    elif sensor.note:
        yield _line("caution", sensor.note, sensor.name, f"The {word} reports: {sensor.note}.", "Look at Sensors.")
    if age_s is None:
        if sensor.name == "imu":
            cause = "The board sends no IMU samples, without which there is no navigation."
            yield _line("warning", "imu-missing", "imu", cause, "Enable its raw sensor stream (HIGHRES_IMU).")
    elif age_s > SENSOR_STALE_S.get(sensor.name, LOST_S):
        severity = "warning" if sensor.name == "imu" else "caution"
        cause = f"No fresh {word} sample for {age_s:.0f} s."
        yield _line(severity, "sensor-stale", sensor.name, cause, f"Check the {word} on the board.", age_s=age_s)
    elif sensor.name == "imu" and sensor.rate_hz < IMU_RATE_LOW_HZ:
        cause = f"The IMU arrives at {sensor.rate_hz:.0f} Hz only; fast turns are missed."
        remedy = "Raise its stream rate and, if the port is full, the baud rate."
        yield _line("caution", "imu-slow", "imu", cause, remedy, rate_hz=sensor.rate_hz)


def _aids(view: BoardView) -> Iterator[VerdictOut]:
    if view.snapshot is None or not view.snapshot.lanes:
        return
    for aid in view.snapshot.aids:
        yield from _aid(view, aid)


def _aid(view: BoardView, aid: AidHealth) -> Iterator[VerdictOut]:
    if not aid.last:
        return
    status, age_s = AidStatus(int(aid.last[1])), view.age_of_s(aid.t_fused_ns)
    if status is AidStatus.FUSED or status in EXPECTED or (age_s is not None and age_s < AID_STALE_S):
        return
    name = aid.aid.name.lower()
    reason, remedy = REASONS.get(status, ("it is refused", "Look at Estimators."))
    when = "never used" if age_s is None else f"not used for {age_s:.0f} s"
    cause = f"{name.replace('_', ' ').capitalize()} is {when}: {reason}."
    yield _line("caution", f"aid-{status.name.lower().replace('_', '-')}", f"aid:{name}", cause, remedy, age_s=age_s)


def _lanes(view: BoardView) -> Iterator[VerdictOut]:
    failures = {info.name: info.failure for info in view.lane_infos if info.failure and info.name in view.lanes}
    for name, failure in failures.items():
        severity: Severity = "warning" if name == view.lanes[0] else "caution"
        cause = f"The estimator {name} was put aside: {failure}."
        yield _line(severity, "lane-put-aside", f"lane:{name}", cause, PUT_ASIDE_REMEDY)
    for lane in view.snapshot.lanes if view.snapshot is not None else ():
        if lane.lane not in failures:
            yield from _lane(lane) if lane.lane == view.lanes[0] else _other_lane(lane)


def _other_lane(lane: LaneState) -> Iterator[VerdictOut]:
    """Of an estimator that only runs beside the main one, its failure alone is a trouble of the board."""
    if lane_status(lane) is LaneStatus.FAILED:
        cause = f"The estimator {lane.lane} gave up: its state was no longer consistent."
        yield _line("caution", "lane-failed", f"lane:{lane.lane}", cause, "Wait: it starts again by itself.")


def _site(view: BoardView) -> Iterator[VerdictOut]:
    site = view.snapshot.site if view.snapshot is not None else None
    if site is None or site.date_source not in {"settings", "board"}:
        return
    if site.decimal_year in {WMM_FIRST_YEAR, WMM_LAST_YEAR}:  # held there: the date told lies beyond
        cause = f"The date lies outside the magnetic model's life; its field of {site.decimal_year:.1f} is used."
        remedy = "Check the date of the board or of the settings, or update navdeck."
        yield _line("caution", "magnetic-model-date", "mag", cause, remedy, decimal_year=site.decimal_year)


def _lane(lane: LaneState) -> Iterator[VerdictOut]:
    status, subject = lane_status(lane), f"lane:{lane.lane}"
    if status is LaneStatus.FAILED:
        cause = "The estimator gave up: its state was no longer consistent."
        yield _line("warning", "lane-failed", subject, cause, "Hold the vehicle still; it starts again by itself.")
    elif status is LaneStatus.ALIGNING:
        cause = "The estimator looks for level and north."
        yield _line("info", "lane-aligning", subject, cause, "Keep the vehicle still for a few seconds.")
    elif status is LaneStatus.ATTITUDE and lane.provides == "full":
        cause = "Orientation is known, position is not: there was no GNSS fix yet."
        yield _line("caution", "lane-attitude-only", subject, cause, "Give the GNSS antenna a free view of the sky.")
    elif status is LaneStatus.DEAD_RECKONING:
        since_s = float(lane.row[DEAD_RECKONING_AT])
        severity: Severity = "warning" if since_s >= 10.0 else "caution"
        cause = f"Position is extrapolated for {since_s:.0f} s, without any fix; its error grows."
        if math.isnan(since_s):
            cause = "Position is extrapolated, without any fix; its error grows."
        remedy = "Bring GNSS back; do not trust the position beyond its shown uncertainty."
        yield _line(severity, "dead-reckoning", subject, cause, remedy, dead_reckoning_s=since_s)


def lane_status(lane: LaneState) -> LaneStatus:
    """Return the state of a lane; one without a row is still aligning."""
    value = float(lane.row[STATUS_AT]) if lane.row.size else math.nan
    return LaneStatus.ALIGNING if math.isnan(value) else LaneStatus(int(value))
