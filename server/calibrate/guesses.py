"""Poses in tables that no clock goes with, or a slow one: what a person would see in them at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from server.calibrate.columns import MAIN_KIND
from server.calibrate.fitting import fit_all, fit_ranges
from server.calibrate.jumps import ranges_by_jumps
from server.calibrate.order import Piece
from server.calibrate.pieces import DEFAULT_RATE_HZ
from server.nav.calibration.grades import POOR
from server.nav.calibration.types import CalKind, Fit, Options

POSE_KINDS: Final = frozenset({CalKind.ACCEL_SIX_POSITION, CalKind.ACCEL_MULTI_POSE})
SLOW_RATE_HZ: Final = 10.0
SLOW_STEP_S: Final = 0.08
UNTIMED: Final = "No time column"
JUMP_REASONS: Final = frozenset({"gravity", "pose-missing", "poses-alike", "too-few-poses"})
"""Refusals that say more of a table of poses than that it is too short for a stream."""


def guessed(
    refused: Fit, kind: CalKind, options: Options, pieces: Sequence[Piece], notes: list[str], *, is_untimed: bool
) -> Fit:
    """Return the fit of the same samples read slower, or cut at their jumps, and note it; else a refusal.

    Args:
        refused: what the samples gave as they came.
        kind: one of `POSE_KINDS`.
        options: as told.
        pieces: the samples.
        notes: for people; changed in place.
        is_untimed: nobody told the rate.
    """
    fit = _read_slower(refused, kind, options, pieces, notes) if is_untimed else refused
    if fit.ok or not (is_untimed or _is_slow(pieces)):
        return fit
    return _by_jumps(fit, kind, options, pieces, notes)


def _read_slower(refused: Fit, kind: CalKind, options: Options, pieces: Sequence[Piece], notes: list[str]) -> Fit:
    """Return the fit of samples whose rate nobody told, read slower; else the refusal as it was."""
    slower = [replace(piece, t_ns=piece.t_ns * round(DEFAULT_RATE_HZ / SLOW_RATE_HZ)) for piece in pieces]
    fit = fit_all(kind, options, slower)
    if not fit.ok or fit.grade == POOR:  # a guess has to fit well
        return refused
    notes[:] = [note for note in notes if not note.startswith(UNTIMED)]
    notes.append(
        f"{UNTIMED}: at {DEFAULT_RATE_HZ:g} samples a second there were too few poses, so {SLOW_RATE_HZ:g} a second "
        "are assumed. Give --rate-hz or --ranges."
    )
    return fit


def _is_slow(pieces: Sequence[Piece]) -> bool:
    """Return whether samples are so far apart that a pose of a few seconds is a handful."""
    steps = np.concatenate([np.diff(piece.t_ns) for piece in pieces] or [np.zeros(1)])
    return len(steps) > 0 and float(np.median(steps)) >= SLOW_STEP_S * 1e9


def _by_jumps(refused: Fit, kind: CalKind, options: Options, pieces: Sequence[Piece], notes: list[str]) -> Fit:
    """Return the fit of what lies between two jumps, each as a pose; else the refusal that says more."""
    rows = np.concatenate([piece.rows for piece in pieces if piece.kind is MAIN_KIND[kind]])
    ranges = ranges_by_jumps(rows[:, 3:6])
    if not ranges:
        return refused
    fit = fit_ranges(kind, options, pieces, ranges)
    if fit.failure is not None:
        return fit if fit.failure.code in JUMP_REASONS else refused
    untimed = any(note.startswith(UNTIMED) for note in notes)
    notes[:] = [note for note in notes if not note.startswith(UNTIMED)]
    notes.append(
        f"{UNTIMED if untimed else 'Few samples a pose'}: what lies between two jumps is taken as one pose, "
        f"{len(ranges)} of them. Give --ranges."
    )
    return fit
