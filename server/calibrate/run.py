"""Files through the very collectors that run live; one result."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from server.calibrate.columns import SENSOR_OF_XYZ
from server.calibrate.errors import CalibrateError
from server.calibrate.fitting import collector_of, feed, fit_all, fit_ranges
from server.calibrate.guesses import POSE_KINDS, UNTIMED, guessed
from server.calibrate.logs import is_log, read_log
from server.calibrate.order import Piece
from server.calibrate.pieces import DEFAULT_RATE_HZ, read_csvs
from server.calibrate.told import Told, ranges_of
from server.magnetic import WMM_EPOCH_YEAR, wmm_field
from server.nav.calibration.applied import Calibration, conditioned, merged
from server.nav.calibration.types import GRAVITY_M_S2, SENSOR_OF, CalKind, Check, Fit, Options, Value
from server.nav.earth import normal_gravity
from server.nav.types import Site

TIMELESS: Final = frozenset({CalKind.MAG_ELLIPSOID})
"""Kinds whose result does not depend on when a sample was taken."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """What came of it: the fit, the check on fresh data if asked for, and what a person should know."""

    fit: Fit
    check: Check | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Read:
    pieces: tuple[Piece, ...]
    site: Site | None
    notes: tuple[str, ...]
    is_untimed: bool = False


def calibrate(told: Told) -> Result:
    """Read, fit, and check.

    Raises:
        CalibrateError: a file or an option is not usable.
    """
    ranges = ranges_of(told.ranges, told.kind, told.axis) if told.ranges else ()
    read = _read(told.files, told, timed=not (ranges and told.kind is not CalKind.GYRO_SCALE))
    notes = list(read.notes)
    options = _options(told, read.site, notes)
    present = _present(told.applied)
    pieces = _conditioned(told.kind, read.pieces, present)
    if ranges:
        fit = fit_ranges(told.kind, options, pieces, ranges)
    else:
        fit = fit_all(told.kind, options, pieces)
        if not fit.ok and told.kind in POSE_KINDS:
            fit = guessed(fit, told.kind, options, pieces, notes, is_untimed=read.is_untimed)
    check = None
    if told.verify and fit.ok:
        fresh = _read(told.verify, told, timed=True)
        notes += [f"--verify: {note}" for note in fresh.notes]
        judge = collector_of(told.kind, options)
        feed(judge, _conditioned(told.kind, fresh.pieces, present))
        check = judge.check(fit.parameters)
    return Result(fit=fit, check=check, notes=tuple(dict.fromkeys(notes)))


def _read(paths: Sequence[Path], told: Told, *, timed: bool) -> _Read:
    logs = [path for path in paths if is_log(path)]
    if logs and len(paths) > 1:
        raise CalibrateError(f"{logs[0]} is a log and stands alone. Give one log, or CSV files.")
    if logs:
        if told.unit == "raw":
            raise CalibrateError(f"{logs[0]} is in SI units and gauss. Leave --unit raw away.")
        log = read_log(logs[0])
        return _Read(pieces=log.pieces, site=log.site, notes=log.notes)
    samples = read_csvs(paths, told)
    notes = list(samples.notes)
    if not samples.has_stamps and timed and told.kind not in TIMELESS and not math.isfinite(told.rate_hz):
        notes.append(f"{UNTIMED}: {DEFAULT_RATE_HZ:g} samples a second are assumed. Give --rate-hz.")
    untimed = not samples.has_stamps and not math.isfinite(told.rate_hz)
    return _Read(pieces=samples.pieces, site=None, notes=tuple(notes), is_untimed=untimed)


def _options(told: Told, site: Site | None, notes: list[str]) -> Options:
    """Return the collector's options; what a person told wins over the log's site."""
    field, gravity = _field(told, site, notes)
    strength = told.strength
    in_counts = told.unit == "raw" and told.kind is CalKind.MAG_FIXED_HEADING  # gauss of the place say nothing there
    if math.isnan(strength) and field and not in_counts:
        strength = float(np.linalg.norm(field))
    return Options(
        unit=told.unit or "si",
        strength=strength,
        gravity_m_s2=told.gravity_m_s2 if math.isfinite(told.gravity_m_s2) else gravity,
        axis=told.axis,
        turns=told.turns,
        ellipsoid_parameters=told.parameters,
        duration_s=told.duration_s,
        heading_rad=math.radians(told.heading_deg),
        heading_sigma_rad=math.radians(told.heading_sigma_deg),
        field_n_gauss=field,
        height_m=told.height_m,
        rate_hz=told.rate_hz,
    )


def _field(told: Told, site: Site | None, notes: list[str]) -> tuple[tuple[float, ...], float]:
    """Return the Earth's field (NED, gauss) and gravity at the place that was told, else the log's; () = unknown."""
    if math.isnan(told.lat_deg):
        return (site.field_n_gauss, site.gravity_m_s2) if site else ((), GRAVITY_M_S2)
    field, year = wmm_field(told.lat_deg, told.lon_deg, told.alt_m, told.year)
    if math.isnan(told.year) and told.kind in SENSOR_OF_XYZ and SENSOR_OF_XYZ[told.kind] == "mag":
        notes.append(f"The magnetic model is of its epoch, {WMM_EPOCH_YEAR:g}. Give --year.")
    elif math.isfinite(told.year) and year != told.year:
        notes.append(f"The magnetic model does not reach {told.year:g}; {year:g} is used.")
    alt_m = told.alt_m if math.isfinite(told.alt_m) else 0.0
    return tuple(float(v) for v in field), normal_gravity(math.radians(told.lat_deg), alt_m)


def _present(files: Sequence[Path]) -> Calibration:
    """Return the calibration in force: earlier results, the later one of a sensor winning."""
    found = Calibration()
    for path in files:
        try:
            made: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8-sig"))
            if not made["ok"]:
                raise CalibrateError(f"--applied {path} is a refused calibration. Give one that was fitted.")
            kind = CalKind(made["kind"])
            values, sigma = _arrays(made["parameters"]), _arrays(made["sigma"])
            found = found.having(SENSOR_OF[kind], merged(kind, values, sigma, found))
        except OSError as error:
            raise CalibrateError(f"--applied {path} cannot be read: {error.strerror}. Check the path.") from error
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, CalibrateError):
                raise
            raise CalibrateError(
                f"--applied {path} is not a result of this command ({error}). Write it with --out."
            ) from error
    return found


def _arrays(values: Mapping[str, Any]) -> dict[str, Value]:
    """Return JSON's numbers as arrays; null is NaN."""
    return {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}


def _conditioned(kind: CalKind, pieces: Sequence[Piece], present: Calibration) -> Sequence[Piece]:
    """Return the samples as the kind wants them: raw, or with the present calibration as live gives it."""
    if present.is_identity:
        return pieces
    return [replace(piece, rows=conditioned(kind, piece.kind, piece.rows, present)) for piece in pieces]
