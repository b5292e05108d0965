"""In which order collectors take the samples of several files and sensors."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from server.nav.types import Float, Int, Kind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """Samples of one kind in order: t_ns (n,), rows (n, ROW_WIDTH) as `SAMPLE_COLUMNS[kind]`; unknown = NaN."""

    kind: Kind
    t_ns: Int
    rows: Float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stamped:
    """One file: its sensors, its pieces by kind, and whether the stamps are its own."""

    path: Path
    sensors: frozenset[str]
    pieces: dict[Kind, Piece]
    has_stamps: bool


def in_order(files: Sequence[Stamped], wanted: Set[Kind]) -> list[Piece]:
    """Return the pieces as collectors take them, of the wanted kinds of sample alone.

    Files of one kind of sample follow each other. Several kinds are merged by their stamps (an IMU sample after the
    others of its stamp, as in a sensor folder) where the stamps ascend, else file by file.
    """
    parts_of = [{kind: each[kind] for kind in each if kind in wanted} for each in _joined(files)]
    kinds = list(dict.fromkeys(kind for pieces in parts_of for kind in pieces))
    columns = {kind: [pieces[kind] for pieces in parts_of if kind in pieces] for kind in kinds}
    whole = {kind: _concatenated(parts) for kind, parts in columns.items()}
    if len(kinds) == 1 or all((np.diff(piece.t_ns) >= 0).all() for piece in whole.values()):
        return merged_by_time(list(whole.values()))
    return [piece for pieces in parts_of for piece in merged_by_time(list(pieces.values()))]


def _joined(files: Sequence[Stamped]) -> list[dict[Kind, Piece]]:
    """Return each file's pieces, a gyro's and an accelerometer's files of equal stamps made one."""
    found: list[dict[Kind, Piece]] = []
    waiting: tuple[frozenset[str], Piece] | None = None
    for file in files:
        imu = file.pieces.get(Kind.IMU)
        halves = file.sensors & {"gyro", "accel"}
        alone = imu if len(halves) == 1 else None
        if waiting and alone and not halves & waiting[0] and np.array_equal(alone.t_ns, waiting[1].t_ns):
            rows = np.where(np.isnan(waiting[1].rows), alone.rows, waiting[1].rows)
            found[-1][Kind.IMU] = Piece(kind=Kind.IMU, t_ns=alone.t_ns, rows=rows)
            waiting = None
            continue
        waiting = (halves, alone) if alone else None
        found.append(dict(file.pieces))
    return found


def _concatenated(parts: Sequence[Piece]) -> Piece:
    if len(parts) == 1:
        return parts[0]
    t_ns, rows = np.concatenate([part.t_ns for part in parts]), np.concatenate([part.rows for part in parts])
    return Piece(kind=parts[0].kind, t_ns=t_ns, rows=rows)


def merged_by_time(pieces: Sequence[Piece]) -> list[Piece]:
    """Return stretches of one kind each, in the order of their stamps."""
    if len(pieces) == 1:
        return list(pieces)
    ordered = sorted(pieces, key=lambda piece: piece.kind is Kind.IMU)
    which = np.concatenate([np.full(len(piece.t_ns), k) for k, piece in enumerate(ordered)])
    row = np.concatenate([np.arange(len(piece.t_ns)) for piece in ordered])
    order = np.argsort(np.concatenate([piece.t_ns for piece in ordered]), kind="stable")
    which, row = which[order], row[order]
    gathered = [
        piece if (np.diff(rows) == 1).all() else Piece(kind=piece.kind, t_ns=piece.t_ns[rows], rows=piece.rows[rows])
        for piece, rows in ((piece, row[which == k]) for k, piece in enumerate(ordered))
    ]
    return _stretches(gathered, which)


def _stretches(pieces: Sequence[Piece], which: Int) -> list[Piece]:
    """Return views of the pieces, cut wherever the next sample in time is another piece's."""
    if not len(which):
        return []
    edges = np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1, [len(which)]])
    taken, found = [0] * len(pieces), []
    for k, count in zip(which[edges[:-1]].tolist(), np.diff(edges).tolist(), strict=True):
        first, piece = taken[k], pieces[k]
        taken[k] = first + count
        found.append(Piece(kind=piece.kind, t_ns=piece.t_ns[first : taken[k]], rows=piece.rows[first : taken[k]]))
    return found
