"""A campaign's figures as one JSON-ready dictionary: what the text, the file and the HTML report are made of."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from server.montecarlo.campaign import EPOCH_S, LANE, WIND_M_S, Campaign
from server.montecarlo.flight import Flight
from server.montecarlo.statistics import REQUIRED, Curve, nees_curves, nis_curves, rms
from server.nav.health import PSEUDO
from server.nav.types import Float, LaneStatus
from server.sim.path import STAND_S

COMPONENTS: Final = (
    "attitude_n_rad",
    "attitude_e_rad",
    "attitude_d_rad",
    "vel_n_m_s",
    "vel_e_m_s",
    "vel_d_m_s",
    "pos_n_m",
    "pos_e_m",
    "pos_d_m",
)
ASSUMED: Final = tuple(aid.name.lower() for aid in PSEUDO)
"""Aids that measure nothing; their variances are meant to be too large, and nothing is demanded of them."""
_STAND: Final = int(STAND_S / EPOCH_S)


def results(campaign: Campaign, flights: Sequence[Flight]) -> dict[str, Any]:
    """Return the campaign's figures; numbers that are unknown are None."""
    diagonal, nis = nees_curves(flights, full=False), nis_curves(flights)
    told = nees_curves(flights, full=True)
    full = told if told[0].known.any() else []
    error, sigma = rms(flights)
    judged = [curve for curve in (full or diagonal) + nis if curve.name not in ASSUMED and curve.known.any()]
    return {
        "navdeck_version": version("navdeck"),
        "campaign": _campaign(campaign),
        "lane": LANE,
        "covariance": "full" if full else "diagonal",
        "required_share": REQUIRED,
        "passed": bool(judged) and all(curve.share("inside") >= REQUIRED for curve in judged),
        "failing": [curve.name for curve in judged if not curve.share("inside") >= REQUIRED],
        "epochs_s": campaign.epochs_s.tolist(),
        "nees": {curve.name: _curve(curve) for curve in full},
        "nees_diagonal": {curve.name: _curve(curve) for curve in diagonal},
        "nis": {curve.name: _curve(curve) | {"demanded": curve.name not in ASSUMED} for curve in nis},
        "components": {
            name: {"rms_error": _numbers(error[:, i]), "rms_sigma": _numbers(sigma[:, i])}
            for i, name in enumerate(COMPONENTS)
        },
        "flights": [_flight(flight) for flight in flights],
    }


def _campaign(campaign: Campaign) -> dict[str, Any]:
    return {
        "runs": campaign.runs,
        "seconds": campaign.seconds,
        "seed": campaign.seed,
        "told": campaign.told,
        "rtk": campaign.rtk,
        "epoch_s": EPOCH_S,
        "wind_up_to_m_s": WIND_M_S,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    """Return one quantity: its summary over everything, on the ground and in the air, and its curves."""
    return {
        "components": curve.components or None,
        **_summary(curve, slice(None)),
        "standing": _summary(curve, slice(None, _STAND)),
        "flying": _summary(curve, slice(_STAND, None)),
        "mean": _numbers(curve.mean),
        "low": _numbers(curve.low),
        "high": _numbers(curve.high),
    }


def _summary(curve: Curve, part: slice) -> dict[str, float | None]:
    shares = {where: _number(curve.share(where, part)) for where in ("inside", "above", "below")}
    return {"average": _number(curve.average(part)), **shares}


def _flight(flight: Flight) -> dict[str, Any]:
    """Return what became of one flight."""
    horizontal_m = np.hypot(flight.error[:, 6], flight.error[:, 7])
    angle_rad = np.linalg.norm(flight.error[:, :3], axis=1)
    return {
        "seed": flight.board.seed,
        "wind_m_s": flight.board.wind_m_s,
        "aligned_s": _first(flight.status >= LaneStatus.ATTITUDE),
        "navigating_s": _first(flight.status == LaneStatus.NAVIGATING),
        "failed_epochs": int((flight.status == LaneStatus.FAILED).sum()),
        "attitude_rms_rad": _rms(angle_rad),
        "velocity_rms_m_s": _rms(np.linalg.norm(flight.error[:, 3:6], axis=1)),
        "horizontal_rms_m": _rms(horizontal_m),
        "horizontal_max_m": _number(float(np.nanmax(horizontal_m, initial=-1.0))),
        "vertical_rms_m": _rms(flight.error[:, 8]),
        "events": dict(Counter(flight.events)),
    }


def _first(found: NDArray[np.bool_]) -> float | None:
    return (int(np.argmax(found)) + 1) * EPOCH_S if found.any() else None


def _rms(values: Float) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known * known))) if len(known) else None


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _numbers(values: Float) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
