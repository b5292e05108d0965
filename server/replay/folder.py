"""A sensor folder: CSV files in FRD/NED/SI and `meta.toml`, merged into one stream in the order of t_ns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import ROW_WIDTH, SAMPLE_COLUMNS, Float, Int, Kind, SampleBlock
from server.replay.csv_in import Read, read_table
from server.replay.errors import ReplayError, nearest
from server.replay.meta import read_meta
from server.replay.source import Account
from server.replay.tables import TABLES, Table

META: Final = "meta.toml"
UNIT_TOLERANCE: Final = 0.05  # a quaternion further from unit norm than this was not meant as one
_Q30: Final = float(1 << 30)
MAX_FIX_TYPE: Final = 6
_FIX_TYPE: Final = SAMPLE_COLUMNS[Kind.GNSS].index("fix_type")
_QUATERNIONS: Final = (Kind.REFERENCE, Kind.DMP)


class FolderLog:
    """A sensor folder, read whole when opened."""

    kind = "folder"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._losses = {"out_of_order": 0, "duplicate_t_ns": 0, "truncated_lines": 0, "bad_quaternions": 0}
        self._notes = _strange_files(path)
        self.overrides: dict[str, Any] = read_meta(path / META).overrides()
        self._tables = [self._table(path / table.file, table) for table in TABLES if (path / table.file).is_file()]
        if not self._tables:
            known = ", ".join(table.file for table in TABLES)
            raise ReplayError(f"{path} holds none of {known}. Give a .tlog file or a folder with at least one of them.")
        self._order = self._merge()
        self._done = 0

    def _table(self, path: Path, table: Table) -> tuple[Kind, Int, Float]:
        read = read_table(path, table)
        self._notes.extend(read.notes)
        self._losses["truncated_lines"] += read.truncated
        if table.integer:
            read.data[:, : len(table.columns)] = _from_q30(path, read)
        if table.kind in _QUATERNIONS:
            self._losses["bad_quaternions"] += _normalise(read.data[:, :4])
        if table.kind is Kind.GNSS:
            _check_fix_type(path, read)
        t_ns, data = self._in_order(path, read.t_ns, read.data)
        return table.kind, t_ns, data

    def _in_order(self, path: Path, t_ns: Int, data: Float) -> tuple[Int, Float]:
        """Return the rows by ascending t_ns, the first of each stamp; what had to be moved or dropped is counted."""
        steps = np.diff(t_ns)
        if (steps > 0).all():
            return t_ns, data
        backward = int((steps < 0).sum())
        order = np.argsort(t_ns, kind="stable")
        kept = order[np.concatenate(([True], np.diff(t_ns[order]) > 0))]
        self._losses["out_of_order"] += backward
        self._losses["duplicate_t_ns"] += len(order) - len(kept)
        self._notes.append(
            f"{path.name}: t_ns went backwards {backward} times (the rows were sorted) and "
            f"{len(order) - len(kept)} rows had the t_ns of an earlier one (left out)."
        )
        return t_ns[kept], data[kept]

    def _merge(self) -> tuple[NDArray[np.uint8], Int, Int]:
        """Return (table, row in it, t_ns) of every sample, by t_ns; equal stamps in the order of TABLES."""
        table = np.concatenate([np.full(len(t_ns), k, np.uint8) for k, (_, t_ns, _) in enumerate(self._tables)])
        row = np.concatenate([np.arange(len(t_ns)) for _, t_ns, _ in self._tables])
        stamps = np.concatenate([t_ns for _, t_ns, _ in self._tables])
        order = np.argsort(stamps, kind="stable")  # stable: the tables were concatenated in their order
        return table[order], row[order], stamps[order]

    @property
    def t_origin_ns(self) -> int:
        """The earliest t_ns of any file; -1 when all are empty."""
        return int(self._order[2][0]) if len(self._order[2]) else -1

    def blocks(self, rows: int) -> Iterator[SampleBlock]:
        """Yield the merged samples, at most `rows` a block."""
        kinds = np.array([kind for kind, _, _ in self._tables], dtype=np.uint8)
        for start in range(0, len(self._order[2]), rows):
            part = slice(start, start + rows)
            table, row, t_ns = self._order[0][part], self._order[1][part], self._order[2][part]
            data = np.empty((len(t_ns), ROW_WIDTH))
            for k, (_, _, samples) in enumerate(self._tables):
                mine = table == k
                data[mine] = samples[row[mine]]
            self._done = start + len(t_ns)
            yield SampleBlock(kind=kinds[table], t_ns=t_ns.copy(), t_rx_ns=t_ns.copy(), data=data)

    def fraction(self) -> float:
        """Return how much has been handed out, 0 to 1."""
        return self._done / max(1, len(self._order[2]))

    def account(self) -> Account:
        """Return what was read and what was left out."""
        files = [self.path / table.file for table in TABLES if (self.path / table.file).is_file()]
        size = sum(file.stat().st_size for file in files)
        return Account(bytes_in=size, losses=dict(self._losses), notes=tuple(self._notes))


def _strange_files(path: Path) -> list[str]:
    """Return a note for each CSV or TOML file that is not part of the contract."""
    known = {table.file for table in TABLES} | {META}
    found = sorted(p.name for p in path.iterdir() if p.suffix.lower() in {".csv", ".toml"} and p.name not in known)
    return [f"{name} is not part of a sensor folder and is ignored{nearest(name, known)}." for name in found]


def _check_fix_type(path: Path, read: Read) -> None:
    """Raise ReplayError for a fix_type that is none; unknown is one."""
    fix = read.data[:, _FIX_TYPE]
    bad = np.flatnonzero(~np.isnan(fix) & ~np.isin(fix, np.arange(MAX_FIX_TYPE + 1)))
    if len(bad):
        raise ReplayError(
            f"{path}: column fix_type, at t_ns {read.t_ns[bad[0]]}: {fix[bad[0]]:g} is no kind of fix. Write 0 "
            "or 1 for none, 2 two-dimensional, 3 three-dimensional, 4 differential, 5 float, 6 fixed, or empty."
        )


def _from_q30(path: Path, read: Read) -> Float:
    """Return the int32 Q30 columns as numbers; NaN stays."""
    values = read.data[:, :4]
    known = values[np.isfinite(values)]
    if (known != np.rint(known)).any() or (np.abs(known) > 2.0**31).any():
        raise ReplayError(
            f"{path}: q_w, q_x, q_y, q_z must be int32 in Q30 (1.0 is 1073741824). "
            "Multiply unit quaternions by 2^30 and round."
        )
    return np.asarray(values / _Q30)


def _normalise(q_nb: Float) -> int:
    """Make the quaternions of a view (n, 4) unit, NaN where they are none; return how many were none."""
    norm = np.maximum(np.sqrt((q_nb * q_nb).sum(axis=1)), np.finfo(float).tiny)
    bad = np.abs(norm - 1.0) > UNIT_TOLERANCE
    q_nb[bad] = np.nan
    q_nb /= norm[:, None]
    return int(bad.sum())
