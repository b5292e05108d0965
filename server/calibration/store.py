"""The calibration sets of every board on disk: which there are, which are in force, and what was in force before.

Why embedded SQLite and not a file per set: an application changes three things at once (what is in force, the history,
and often a set just added), and they must change together under kill -9 and a power cut. SQLite's rollback journal is
that, measured for twenty years; files with fsync and rename are atomic one by one, and an order of renames that is
right for three files in two processes would be a small database of our own. It is in the standard library, one file,
locked between processes, and checks its own structure. The journal is a rollback journal, not a write-ahead log: there
are a few writes a day, a single file is what people copy, and no shared memory file is left behind by a kill.
`synchronous=EXTRA` makes a commit outlive a power cut too (it also syncs the folder once the journal is gone). What
SQLite does not check, the content of a row, carries a digest of its own.

Raw samples are too large for rows: they are folders of CSV under `samples/`, named by the set.

All calls block for the disk; callers on an event loop use a thread. One lock makes them safe from several threads, the
file's own locking from several processes: each call is one transaction, and a second navdeck sees it whole or not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from server.calibration.diff import Change
from server.calibration.diff import diff as difference
from server.calibration.errors import StoreError
from server.calibration.records import CalibrationSet, composed
from server.calibration.store_access import Access
from server.calibration.store_file import open_store
from server.calibration.store_history import NONE, Applied, roll_back_target
from server.calibration.store_ids import new_id
from server.calibration.store_rows import MAX_HISTORY, Rows, parsed, take_over, utc_now
from server.calibration.store_samples import SampleFolders
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor

MAX_SETS: Final = 200  # of one board and sensor; past that the oldest not in force goes, its samples with it

__all__ = ["MAX_HISTORY", "MAX_SETS", "CalibrationStore", "StoreError"]


class CalibrationStore:
    """Versioned calibration sets per board and sensor; at most one of each sensor is in force.

    Attributes:
        folder: where the file and the samples lie.
        troubles: what went wrong on opening, for people: a damaged file put aside, a folder that cannot be written.
        is_persistent: False when it lives in memory because the folder cannot be used.

    Raises:
        StoreError: every call, "store-busy" (another process holds the file) and "store-unavailable" (full disk, no
            permission); then nothing was changed.
    """

    def __init__(self, folder: Path, *, max_sets: int = MAX_SETS) -> None:
        opened = open_store(folder)
        self.folder = folder
        self.is_persistent = opened.is_persistent
        self.troubles: list[str] = opened.troubles
        self._max_sets = max_sets
        self._connection = opened.connection
        self._access = Access(opened.connection)
        self._rows = Rows(opened.connection)
        self._samples = SampleFolders(folder / "samples")
        if opened.salvage_from is not None:
            with self._access.writing():
                self.troubles[-1] += take_over(opened.salvage_from, self._rows)

    def close(self) -> None:
        """Let go of the file; no further call is allowed."""
        with self._access.lock:
            self._connection.close()

    def samples_folder(self, board_id: str, job_id: str) -> Path:
        """Return where the raw samples of a job belong; `CalibrationSet.samples_file` may hold this path."""
        return self._samples.folder_of(board_id, job_id)

    def samples_of(self, kept: CalibrationSet) -> Path | None:
        """Return the folder of raw samples of a set, None when there is none (any more)."""
        return self._samples.existing(kept.samples_file)

    def trim_samples(self, max_bytes: int) -> int:
        """Delete the oldest sample folders that no set names until at most so much is left; return how many went."""
        with self._access.reading():
            named = self._rows.samples_named()
        return self._samples.trim(max_bytes, named)

    def add(self, found: CalibrationSet) -> CalibrationSet:
        """Keep a set without applying it; return it with its id and time.

        Of one board and sensor `max_sets` are kept: past that the oldest that is not in force goes with its samples.

        Raises:
            StoreError: "set-exists": the board has another set of this id.
        """
        now = utc_now()
        kept = replace(
            found,
            id=found.id or new_id(),
            created_utc=found.created_utc or now,
            samples_file=self._samples.relative(found.samples_file),
        )
        with self._access.writing():
            if self._rows.set_row(kept.board_id, kept.id) is not None:
                raise StoreError("set-exists", f"Board {kept.board_id} has a set {kept.id} already.")
            self._rows.insert(kept)
            gone = self._prune(kept.board_id, kept.sensor, kept.id)
        self._drop_samples(gone)
        return kept

    def sets(self, board_id: str, sensor: Sensor | None = None) -> list[CalibrationSet]:
        """Return the sets of a board, of one sensor or of all, newest first; one that is damaged is left out."""
        with self._access.reading():
            rows = self._rows.set_rows(board_id, sensor)
        return [kept for row in rows if (kept := self._parsed(*row)) is not None]

    def get(self, board_id: str, set_id: str) -> CalibrationSet:
        """Return one set.

        Raises:
            StoreError: "no-such-set".
        """
        with self._access.reading():
            row = self._rows.set_row(board_id, set_id)
        kept = None if row is None else self._parsed(*row)
        if kept is None:
            raise _no_set(board_id, set_id)
        return kept

    def delete(self, board_id: str, set_id: str) -> None:
        """Forget a set and its samples.

        Raises:
            StoreError: "no-such-set"; "set-in-force": apply another or take it off first.
        """
        with self._access.writing():
            samples = self._rows.samples_of(board_id, set_id)
            if samples is None:
                raise _no_set(board_id, set_id)
            if set_id in self._rows.ids_in_force(board_id).values():
                text = f"Set {set_id} is in force. Apply another one, or take it off, before deleting it."
                raise StoreError("set-in-force", text)
            self._rows.delete(board_id, set_id)
        self._drop_samples([samples])

    def apply(self, board_id: str, set_id: str, by: str) -> CalibrationSet:
        """Put a set in force for its sensor and log it; nothing happens when it is in force already.

        Raises:
            StoreError: "no-such-set".
        """
        with self._access.writing():
            kept = self.get(board_id, set_id)
            if self._rows.ids_in_force(board_id).get(kept.sensor) != set_id:
                self._rows.change(board_id, kept.sensor, "apply", set_id, by)
        return kept

    def take_off(self, board_id: str, sensor: Sensor, by: str) -> None:
        """Leave a sensor without a calibration.

        Raises:
            StoreError: "nothing-in-force".
        """
        with self._access.writing():
            if sensor not in self._rows.ids_in_force(board_id):
                raise StoreError("nothing-in-force", f"No calibration of {sensor} is in force.")
            self._rows.change(board_id, sensor, "take_off", NONE, by)

    def roll_back(self, board_id: str, sensor: Sensor, by: str) -> CalibrationSet | None:
        """Put in force what was before, again and again further back; None = there was no calibration before.

        Raises:
            StoreError: "nothing-before".
        """
        with self._access.writing():
            target = self._target(board_id, sensor)
            if target is None:
                raise StoreError("nothing-before", f"Nothing was in force before on {sensor}.")
            kept = None if target == NONE else self.get(board_id, target)
            self._rows.change(board_id, sensor, "roll_back", target, by)
        return kept

    def can_roll_back(self, board_id: str, sensor: Sensor) -> bool:
        """True when something was in force before."""
        with self._access.reading():
            return self._target(board_id, sensor) is not None

    def in_force(self, board_id: str) -> dict[Sensor, CalibrationSet]:
        """Return the set in force of each sensor that has one."""
        with self._access.reading():
            found = {
                sensor: self._parsed(*row)
                for sensor, set_id in self._rows.ids_in_force(board_id).items()
                if (row := self._rows.set_row(board_id, set_id)) is not None
            }
        return {sensor: kept for sensor, kept in found.items() if kept is not None}

    def history(self, board_id: str, sensor: Sensor) -> list[Applied]:
        """Return what was put in force when and by whom, newest first; at most `MAX_HISTORY`."""
        with self._access.reading():
            return list(reversed(self._rows.log(board_id, sensor)))

    def calibration(self, board_id: str) -> Calibration:
        """Return what is in force as preprocessing takes it; sensors without a set are left as they are."""
        return composed(self.in_force(board_id))

    def diff(self, board_id: str, old_id: str, new_id: str) -> tuple[Change, ...]:
        """Return two sets side by side, number by number; "" stands for no calibration.

        Raises:
            StoreError: "no-such-set"; "sensor-mismatch".
        """
        sides = [self.get(board_id, set_id) if set_id else None for set_id in (old_id, new_id)]
        try:
            return difference(*sides)
        except ValueError as error:
            raise StoreError("sensor-mismatch", f"{error}.") from error

    def _parsed(self, body: str, digest: str, set_id: str) -> CalibrationSet | None:
        kept, reason = parsed(body, digest)
        if kept is None:
            text = f"Set {set_id} is damaged ({reason}); it is left out."
            if text not in self.troubles:
                self.troubles.append(text)
        return kept

    def _prune(self, board_id: str, sensor: Sensor, keep_id: str) -> list[str]:
        """Delete the oldest sets beyond the bound; return their samples."""
        rows = self._rows.ids_and_samples(board_id, sensor)
        keep = {keep_id, self._rows.ids_in_force(board_id).get(sensor, NONE)}
        room = self._max_sets - sum(set_id in keep for set_id, _ in rows)
        gone = [row for row in rows if row[0] not in keep][max(0, room) :]
        for set_id, _ in gone:
            self._rows.delete(board_id, set_id)
        return [samples for _, samples in gone]

    def _drop_samples(self, names: list[str]) -> None:
        with self._access.reading():
            for name in set(names) - self._rows.samples_named() - {""}:
                self._samples.drop(name)

    def _target(self, board_id: str, sensor: Sensor) -> str | None:
        there = frozenset(set_id for set_id, _ in self._rows.ids_and_samples(board_id, sensor))
        return roll_back_target(self._rows.log(board_id, sensor), there)


def _no_set(board_id: str, set_id: str) -> StoreError:
    return StoreError("no-such-set", f"Board {board_id} has no calibration set {set_id[:80]!r}.")
