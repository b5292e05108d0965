"""Who may touch the store's file when: one thread at a time, each change whole or not at all."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Iterator

from server.calibration.errors import StoreError
from server.calibration.store_file import busy, is_locked


class Access:
    """The lock of one connection; what SQLite refuses becomes a `StoreError`."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self.lock = threading.RLock()
        self._connection = connection

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Hold the connection.

        Raises:
            StoreError: "store-busy", "store-unavailable".
        """
        with self.lock:
            try:
                yield
            except sqlite3.Error as error:
                raise _failed(error) from error

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Do it all or nothing: the transaction is the unit that a kill leaves whole; not to be nested."""
        with self.reading():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._connection.execute("COMMIT")
            finally:
                if self._connection.in_transaction:
                    with contextlib.suppress(sqlite3.Error):  # the journal undoes it at the next opening
                        self._connection.execute("ROLLBACK")


def _failed(error: sqlite3.Error) -> StoreError:
    if is_locked(error):
        return busy()
    return StoreError("store-unavailable", f"The calibration store cannot be used: {error}. Nothing was changed.")
