"""The rows of the store: every SQL statement, and a set as a row with the digest that says it is whole."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from server.calibration.records import CalibrationSet
from server.calibration.records_json import from_json, to_json
from server.calibration.store_file import salvaged
from server.calibration.store_history import NONE, Action, Applied
from server.nav.calibration.types import Sensor

MAX_HISTORY: Final = 1000  # rows of one board and sensor; past that the oldest go
Row = tuple[str, str, str]
"""body, digest, id."""


class Rows:
    """Statements on an open file; no lock, no transaction: the caller has them."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def set_row(self, board_id: str, set_id: str) -> Row | None:
        """Return one set's row."""
        query = "SELECT body, digest, id FROM sets WHERE board_id=? AND id=?"
        row: Row | None = self._connection.execute(query, (board_id, set_id)).fetchone()
        return row

    def set_rows(self, board_id: str, sensor: Sensor | None) -> list[Row]:
        """Return the rows of a board's sets, newest first."""
        wanted = "" if sensor is None else str(sensor)
        query = "SELECT body, digest, id FROM sets WHERE board_id=? AND (?='' OR sensor=?) ORDER BY n DESC"
        return self._connection.execute(query, (board_id, wanted, wanted)).fetchall()

    def ids_and_samples(self, board_id: str, sensor: Sensor) -> list[tuple[str, str]]:
        """Return (id, samples) of a sensor's sets, newest first."""
        query = "SELECT id, samples FROM sets WHERE board_id=? AND sensor=? ORDER BY n DESC"
        return self._connection.execute(query, (board_id, str(sensor))).fetchall()

    def samples_named(self) -> frozenset[str]:
        """Return every sample folder that a set names."""
        return frozenset(str(row[0]) for row in self._connection.execute("SELECT DISTINCT samples FROM sets"))

    def samples_of(self, board_id: str, set_id: str) -> str | None:
        """Return the sample folder of a set, None when there is no such set."""
        query = "SELECT samples FROM sets WHERE board_id=? AND id=?"
        row = self._connection.execute(query, (board_id, set_id)).fetchone()
        return None if row is None else str(row[0])

    def insert(self, kept: CalibrationSet) -> None:
        """Write a set."""
        body = json.dumps(to_json(kept), allow_nan=False, ensure_ascii=False, sort_keys=True)
        values = (kept.board_id, kept.id, str(kept.sensor), kept.samples_file, body, _digest(body))
        statement = "INSERT INTO sets(board_id, id, sensor, samples, body, digest) VALUES(?,?,?,?,?,?)"
        self._connection.execute(statement, values)

    def delete(self, board_id: str, set_id: str) -> None:
        """Forget a set that is not in force."""
        self._connection.execute("DELETE FROM sets WHERE board_id=? AND id=?", (board_id, set_id))

    def ids_in_force(self, board_id: str) -> dict[Sensor, str]:
        """Return what is in force of each sensor that has something."""
        rows = self._connection.execute("SELECT sensor, set_id FROM in_force WHERE board_id=?", (board_id,))
        return {Sensor(sensor): str(set_id) for sensor, set_id in rows}

    def log(self, board_id: str, sensor: Sensor) -> list[Applied]:
        """Return the history, oldest first."""
        query = "SELECT action, old, new, by, utc FROM history WHERE board_id=? AND sensor=? ORDER BY n"
        rows = self._connection.execute(query, (board_id, str(sensor)))
        return [Applied(action=action, old=old, new=new, by=by, utc=utc) for action, old, new, by, utc in rows]

    def change(self, board_id: str, sensor: Sensor, action: Action, new: str, by: str) -> None:
        """Put a set in force, or none, and log it."""
        old, whose = self.ids_in_force(board_id).get(sensor, NONE), (board_id, str(sensor))
        if new == NONE:
            self._connection.execute("DELETE FROM in_force WHERE board_id=? AND sensor=?", whose)
        else:
            self._connection.execute("INSERT OR REPLACE INTO in_force VALUES(?,?,?)", (*whose, new))
        self._connection.execute(
            "INSERT INTO history(board_id, sensor, action, old, new, by, utc) VALUES(?,?,?,?,?,?,?)",
            (*whose, action, old, new, by, utc_now()),
        )
        self._connection.execute(
            "DELETE FROM history WHERE n IN (SELECT n FROM history WHERE board_id=? AND sensor=?"
            " ORDER BY n DESC LIMIT -1 OFFSET ?)",
            (*whose, MAX_HISTORY),
        )


def parsed(body: object, digest: object) -> tuple[CalibrationSet | None, str]:
    """Return the set of a row, or None and why it is not one."""
    if not isinstance(body, str) or _digest(body) != digest:
        return None, "its digest does not fit"
    try:
        return from_json(json.loads(body)), ""
    except ValueError as error:
        return None, str(error)


def take_over(aside: Path, rows: Rows) -> str:
    """Insert what of a damaged file can still be read and is whole; say how much that was."""
    taken = 0
    for _, board_id, set_id, _, _, body, digest in salvaged(aside, "sets"):
        kept, _reason = parsed(body, digest)
        fits = kept is not None and (kept.board_id, kept.id) == (board_id, set_id)
        if kept is not None and fits and rows.set_row(kept.board_id, kept.id) is None:
            rows.insert(kept)
            taken += 1
    for board_id, sensor, set_id in salvaged(aside, "in_force"):
        row = rows.set_row(str(board_id), str(set_id))
        kept = None if row is None else parsed(*row[:2])[0]
        if kept is not None and str(kept.sensor) == sensor:
            rows.change(kept.board_id, kept.sensor, "recovered", kept.id, "navdeck")
    return f" {taken} sets could be read and were taken over; please check what is in force."


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:32]


def utc_now() -> str:
    """Return the time as the store writes it: ISO 8601, milliseconds, "Z"."""
    return datetime.now(tz=UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
