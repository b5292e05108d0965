"""The output directory: written beside its place and moved into it whole, and nobody else's files touched."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from pathlib import Path
from types import TracebackType
from typing import Final

from server.replay.errors import ReplayError

SUMMARY: Final = "summary.json"
_FORMAT_PREFIX: Final = "navdeck.replay.summary/"


class Output:
    """A directory that appears, or changes, only when everything in it was written.

    Use as a context manager: leaving it without `commit` leaves no trace.

    Raises:
        ReplayError: the place holds something that is not an earlier replay, or cannot be written.
    """

    def __init__(self, place: Path, log: Path, *, overwrite: bool = False) -> None:
        self.place = place
        self._stale = _earlier_files(place, log, overwrite=overwrite)
        self._draft = place.absolute().parent / f".{place.name or 'replay'}.{secrets.token_hex(4)}.partial"
        self._names: list[str] = []

    def __enter__(self) -> Output:
        try:
            self._draft.parent.mkdir(parents=True, exist_ok=True)
            self._draft.mkdir()
        except OSError as error:
            raise ReplayError(
                f"{self.place} cannot be written: {error.strerror}. Choose another --out or free its parent directory."
            ) from error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        shutil.rmtree(self._draft, ignore_errors=True)

    def write(self, name: str, *parts: bytes) -> None:
        """Write one file of the directory to be."""
        try:
            with (self._draft / name).open("wb") as file:
                file.writelines(parts)
        except OSError as error:
            raise ReplayError(f"{self.place / name} cannot be written: {error.strerror}. Free some space.") from error
        self._names.append(name)

    def commit(self) -> None:
        """Move everything into place; files of the earlier replay that were not written again are removed."""
        try:
            if not self.place.exists():
                self._draft.rename(self.place)
                return
            for name in sorted(self._names, key=lambda name: name == SUMMARY):  # the summary last
                os.replace(self._draft / name, self.place / name)
            for name in self._stale - set(self._names):
                (self.place / name).unlink(missing_ok=True)
        except OSError as error:
            raise ReplayError(f"{self.place} cannot be written: {error.strerror}. Choose another --out.") from error


def _earlier_files(place: Path, log: Path, *, overwrite: bool) -> set[str]:
    """Return the files an earlier replay left in the place; refuse a place that is somebody else's."""
    if not place.exists():
        return set()
    if not place.is_dir():
        raise ReplayError(f"{place} is a file. Give --out a directory.")
    if log.is_dir() and place.samefile(log):
        raise ReplayError(f"{place} is the log itself: its reference.csv would be lost. Give --out another directory.")
    found = _files_of_summary(place / SUMMARY)
    if found is None and any(place.iterdir()) and not overwrite:
        raise ReplayError(
            f"{place} is not empty and holds no earlier replay. Give --out a new directory, or --overwrite to write "
            "into this one (files of other names stay)."
        )
    return found or set()


def _files_of_summary(path: Path) -> set[str] | None:
    """Return the CSV files a summary of ours names, or None when it is not ours."""
    try:
        summary = json.loads(path.read_bytes())
        if not str(summary["format"]).startswith(_FORMAT_PREFIX):
            return None
        listed = [*summary["lanes"].values(), *summary.get("stages", {}).values()]
        listed += (summary.get("mag_learning") or {}).get("power_ups", [])
        names = {Path(str(each["file"])).name for each in listed}
        return {name for name in names if name.endswith(".csv")}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
