"""One flight: the demo board's bytes through memory into protocol and engine, and the errors at every epoch.

The path is that of a live board from the link on. Truth is the generator's own at the stamp of the lane's row, not what
SIM_STATE carries, which the wire rounds to a centimetre.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from server.magnetic import wmm_field
from server.montecarlo.campaign import EPOCH_S, LANE, Campaign
from server.nav.consistency import normalised
from server.nav.engine import NavEngine
from server.nav.nees import place_errors, rotation_errors
from server.nav.types import LANE_COLUMNS, Aid, AidRows, AidStatus, Float, Int, LaneStatus, StepResult
from server.protocol.mavlink.protocol import MavlinkProtocol
from server.sim import SimSettings, SimStream, earth
from server.sim.truth import FlightTruth

COUNTED: Final = (AidStatus.FUSED, AidStatus.REFUSED_GATE)
_STATUS: Final = LANE_COLUMNS.index("status")
_VEL: Final = LANE_COLUMNS.index("vel_n_m_s")
_LLA: Final = LANE_COLUMNS.index("lat_deg")
_SIGMA: Final = LANE_COLUMNS.index("sigma_att_x_rad")


@dataclass(slots=True, kw_only=True, eq=False)
class Flight:
    """What one flight gave, a row an epoch; unknown = NaN.

    Attributes:
        board: the demo board's settings.
        error: shape (n, 9), true minus estimated: attitude NED rad, velocity NED m/s, position NED m.
        sigma: shape (n, 9), as published.
        P: shape (n, 9, 9), covariance of `error` as the lane tells it.
        nis: shape (aids, n, 3), the last normalised innovation of each epoch.
        status: shape (n,), `LaneStatus`; -1 before the first row.
        events: codes of the lane's events, in order.
    """

    board: SimSettings
    error: Float
    sigma: Float
    P: Float
    nis: Float
    status: Int
    events: list[str] = field(default_factory=list)


def fly(campaign: Campaign, run: int) -> Flight:
    """Fly one flight of a campaign."""
    board = campaign.board(run)
    n = len(campaign.epochs_s)
    flight = Flight(
        board=board,
        error=np.full((n, 9), math.nan),
        sigma=np.full((n, 9), math.nan),
        P=np.full((n, 9, 9), math.nan),
        nis=np.full((len(Aid), n, 3), math.nan),
        status=np.full(n, -1, dtype=np.int64),
    )
    truth = FlightTruth(board)
    engine, protocol = NavEngine(campaign.engine(), wmm_field), MavlinkProtocol(talk=False)
    for k, data in enumerate(_epochs(board, n)):
        at_ns = round((k + 1) * EPOCH_S * 1e9)
        for block in protocol.feed(data, at_ns).blocks:
            _note(flight, k, engine.step(block), engine, truth)
    return flight


def _epochs(board: SimSettings, n: int) -> Iterator[bytes]:
    """Yield the bytes of one epoch after the other."""
    stream = SimStream(board)
    for k in range(1, n + 1):
        yield b"".join(stream.advance(round(k * EPOCH_S * 1e9)))


def _note(flight: Flight, k: int, result: StepResult, engine: NavEngine, truth: FlightTruth) -> None:
    """Put what one call of the engine gave into epoch k; what comes later in the epoch replaces it."""
    flight.events += [event.code for event in result.events]
    _note_aids(flight, k, result.aids)
    for rows in result.lanes:
        if rows.lane == LANE and len(rows.t_ns):
            row = rows.data[-1]
            flight.status[k] = int(row[_STATUS])
            if flight.status[k] not in {LaneStatus.ALIGNING, LaneStatus.FAILED}:
                flight.error[k] = _errors(row, int(rows.t_ns[-1]), truth)
                flight.sigma[k] = row[_SIGMA : _SIGMA + 9]
                flight.P[k] = _covariance(engine, int(rows.t_ns[-1]), flight.sigma[k])


def _note_aids(flight: Flight, k: int, aids: AidRows) -> None:
    counts = np.isin(aids.data[:, 1], COUNTED)
    x, aid = normalised(aids.data[counts]), aids.data[counts, 0].astype(np.int64)
    flight.nis[aid, k] = x  # with repeated indices the last one stays


def _errors(row: Float, t_ns: int, truth: FlightTruth) -> Float:
    state = truth.at(np.array([t_ns * 1e-9]))
    own = row[None, :]
    place = earth.geodetic_from_ned(state.pos_n_m)
    parts = (
        rotation_errors(own[:, :4], state.q_nb)[0],
        state.vel_n_m_s[0] - row[_VEL : _VEL + 3],
        place_errors(own[:, _LLA : _LLA + 3], place)[0],
    )
    return np.concatenate(parts)


def _covariance(engine: NavEngine, t_ns: int, sigma: Float) -> Float:
    """Return P at `t_ns`, states that are not published yet unknown; NaN when the lane cannot tell it."""
    told = engine.covariance(LANE)
    if told is None or told[0] != t_ns:
        return np.full((9, 9), math.nan)
    P = told[1].copy()
    unknown = ~np.isfinite(sigma)
    P[unknown, :] = P[:, unknown] = math.nan
    return P
