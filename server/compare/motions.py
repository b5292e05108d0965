"""`navdeck compare --five-motions`: attitude lanes over five motions [S4 §4], altitude lanes under a misled baro [S3].

The motions carry their truth; every lane runs on the very same samples, with its defaults unless told otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from server.compare.contract import FiveMotionsOut, MotionLaneOut, MotionOut
from server.compare.cost import Costs, measure
from server.compare.delay import delays
from server.compare.figures import STATUS, LaneData, lanes_of
from server.compare.flight import fly
from server.compare.noise import noise
from server.compare.signals import Rows, roll_pitch_yaw, wrapped
from server.magnetic import wmm_field
from server.nav.types import EngineSettings, Float, Int, Kind, SampleBlock
from server.replay.csv_out import STATUS_WORDS
from server.replay.errors import ReplayError
from server.replay.interpolate import sampled
from server.replay.run import nav_engine
from server.replay.score import spread
from server.replay.summary import navdeck_version
from server.sim.earth import SITE_ALT_M, SITE_LAT_DEG, SITE_LON_DEG, pressure_pa
from server.sim.motions import BARO_DISTURBANCE_M, MOTIONS, baro_error_m, motion

ALTITUDE: Final = "altitude"
"""The motion that the altitude lanes are compared on: its air flow misleads the barometer."""
NO_HEADING: Final = frozenset({"dmp"})
"""Lanes whose heading counts from where the board was switched on."""
MOVED_M, MOVED_RAD = 0.02, 0.01
"""The motion has begun once the truth is so far from where it began."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """One motion's figures and the curves behind them."""

    out: MotionOut
    lanes: Mapping[str, LaneData]
    t_origin_ns: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FiveMotions:
    """Everything a report needs."""

    out: FiveMotionsOut
    attitude: Sequence[Moved]
    altitude: Sequence[Moved]


def five_motions(
    lanes: Sequence[str],
    *,
    seed: int = 1,
    parameters: Mapping[str, Mapping[str, float]] | None = None,
    progress: Callable[[float], None] | None = None,
) -> FiveMotions:
    """Run every lane over every motion.

    Args:
        lanes: to compare.
        seed: of the motions' noise.
        parameters: lane → parameter → value, for what differs from the defaults.
        progress: told the share done, 0 to 1.

    Raises:
        ReplayError: a seed, lane or parameter that is not usable.
    """
    if seed < 0:
        raise ReplayError(f"--seed {seed} is negative. Give a whole number from 0 on.")
    chosen = dict(parameters or {})
    settings = EngineSettings(
        lanes=tuple(dict.fromkeys((*lanes, "reference"))),
        lane_parameters=chosen,
        site_lat_deg=SITE_LAT_DEG,  # the bench has no GNSS
        site_lon_deg=SITE_LON_DEG,
        site_alt_m=SITE_ALT_M,
    )
    five = [name for name in MOTIONS if name != ALTITUDE]
    jobs = [(name, list(motion(name, seed))) for name in five]
    flight = motion(ALTITUDE, seed)
    jobs += [(ALTITUDE, calmed(flight)), (ALTITUDE, list(flight))]
    done = []
    for place, (name, blocks) in enumerate(jobs):
        disturbance_m = BARO_DISTURBANCE_M if place == len(jobs) - 1 else 0.0
        done.append(_moved(name, blocks, disturbance_m, settings))
        if progress is not None:
            progress((place + 1) / len(jobs))
    attitude, altitude = done[: len(five)], done[len(five) :]
    out = FiveMotionsOut(
        navdeck_version=navdeck_version(),
        seed=seed,
        parameters={lane: dict(values) for lane, values in chosen.items()},
        attitude=[one.out for one in attitude],
        altitude=[one.out for one in altitude],
        notes=_notes(done),
    )
    return FiveMotions(out=out, attitude=attitude, altitude=altitude)


def calmed(blocks: Sequence[SampleBlock]) -> list[SampleBlock]:
    """Return the altitude motion with a barometer that air flow does not mislead; all else, noise too, is the same."""
    out = []
    for block in blocks:
        data, baro = block.data.copy(), block.kind == Kind.BARO
        data[baro, 1] -= baro_error_m(ALTITUDE, block.t_ns[baro] * 1e-9)
        data[baro, 0] = pressure_pa(data[baro, 1])
        out.append(replace(block, data=data))
    return out


def _moved(name: str, blocks: list[SampleBlock], disturbance_m: float, settings: EngineSettings) -> Moved:
    """Return one motion's figures."""
    flight = fly(blocks, nav_engine(settings, wmm_field)).flights[0]
    costs = measure(blocks, settings, wmm_field)
    lanes = lanes_of(flight, settings.lanes, "reference", "reference")
    begun_ns = _begin(lanes["reference"].rows)
    north = bool(flight.boot.samples[Kind.MAG] or flight.boot.samples[Kind.GNSS])
    figures = {
        lane: _figures(lane, data, costs, begun_ns, north=north) for lane, data in lanes.items() if lane != "reference"
    }
    out = MotionOut(
        motion=name,
        baro_disturbance_m=disturbance_m,
        duration_s=(flight.boot.t_last_ns - flight.boot.t_first_ns) * 1e-9,
        lanes={lane: one for lane, one in figures.items() if sum(one.status_rows.values())},
    )
    return Moved(out=out, lanes=lanes, t_origin_ns=flight.boot.t_first_ns)


def _begin(truth: Rows) -> int:
    """Return when the truth first leaves where it began, ns; its end when it never does."""
    data = truth.data
    height = np.abs(data[:, 6] - data[0, 6]) > MOVED_M
    turned = np.abs(wrapped(roll_pitch_yaw(data[:, :4]) - roll_pitch_yaw(data[:1, :4]))).max(axis=1) > MOVED_RAD
    speed = np.linalg.norm(data[:, 7:10], axis=1) > MOVED_M
    found = np.flatnonzero(height | turned | speed)
    return int(truth.t_ns[found[0] if len(found) else -1])


def _figures(lane: str, data: LaneData, costs: Costs, begun_ns: int, *, north: bool) -> MotionLaneOut:
    """Return one lane's figures over a motion."""
    from server.nav.lanes.registry import provides_of

    truth = data.reference
    status = data.data[:, STATUS]
    angles, height_m, climb_m_s = _errors(data.rows, truth, begun_ns)
    return MotionLaneOut(
        provides=provides_of(lane),
        status_rows={word: int((status == place).sum()) for place, word in enumerate(STATUS_WORDS)},
        roll_rad=spread(angles[:, 0]),
        pitch_rad=spread(angles[:, 1]),
        heading_rad=spread(angles[:, 2]) if north and lane not in NO_HEADING else None,
        height_m=spread(height_m),
        vertical_m_s=spread(climb_m_s),
        delay=delays(data.rows, truth) if truth is not None else None,
        noise=noise(data.rows, *data.quiet),
        cost=costs.lanes.get(lane),
    )


def _errors(rows: Rows, truth: Rows | None, begun_ns: int) -> tuple[Float, Float, Float]:
    """Return errors at the lane's stamps: roll, pitch, heading (n, 3); height less its own zero; vertical speed, up."""
    if truth is None or not len(rows.t_ns):
        return np.empty((0, 3)), np.empty(0), np.empty(0)
    at = sampled(rows.t_ns, truth.t_ns, np.ascontiguousarray(truth.data[:, :10]))
    angles = wrapped(roll_pitch_yaw(rows.data[:, :4]) - roll_pitch_yaw(at[:, :4]))
    height_m = rows.data[:, 6] - at[:, 6]
    return angles, height_m - _zero(rows.t_ns, height_m, begun_ns), at[:, 9] - rows.data[:, 9]


def _zero(t_ns: Int, height_m: Float, begun_ns: int) -> float:
    """Return the median before the motion, of the first second when the lane came later, 0 when it never did."""
    known = np.isfinite(height_m)
    before = known & (t_ns < begun_ns)
    if not known.any():
        return 0.0
    first_ns = t_ns[np.argmax(known)]
    return float(np.median(height_m[before if before.any() else known & (t_ns < first_ns + 1_000_000_000)]))


def _notes(done: Sequence[Moved]) -> list[str]:
    absent = {lane for one in done for lane in one.lanes if lane not in one.out.lanes and lane != "reference"}
    return [f"{lane}: no row in some motions; they have nothing it could work on." for lane in sorted(absent)]
