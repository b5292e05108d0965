"""The folders of raw samples beside the store's file: names that stay inside, deletion with the set."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Final

_UNSAFE: Final = re.compile(r"[^A-Za-z0-9_-]+")
_LONGEST: Final = 60


class SampleFolders:
    """Folders `<board>/<job>` under one root; names outside of it are as good as none."""

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()

    def folder_of(self, board_id: str, job_id: str) -> Path:
        """Return the folder of a job's samples; it is not made."""
        return self.root / safe_name(board_id) / safe_name(job_id)

    def relative(self, name: str) -> str:
        """Return a folder's name as sets keep it: relative to the root, so that the store can be moved."""
        if not name:
            return ""
        path = Path(name)
        return path.relative_to(self.root).as_posix() if path.is_relative_to(self.root) else name

    def existing(self, name: str) -> Path | None:
        """Return the folder of this name if there is one under the root."""
        if not name:
            return None
        path = (self.root / name).resolve()
        inside = path.is_relative_to(self.root.resolve()) and path != self.root.resolve()
        return path if inside and path.is_dir() else None

    def drop(self, name: str) -> None:
        """Delete a folder; what cannot be deleted stays and counts when the samples are trimmed."""
        path = self.existing(name)
        if path is not None:
            shutil.rmtree(path, ignore_errors=True)

    def trim(self, max_bytes: int, named: Collection[str]) -> int:
        """Delete the oldest folders that are not named until at most so many bytes are left; return how many."""
        folders = [(f.stat().st_mtime_ns, f, _size(f)) for f in self.root.glob("*/*") if f.is_dir()]
        total, gone = sum(size for _, _, size in folders), 0
        for _, folder, size in sorted(folders):
            if total <= max_bytes:
                break
            if self.relative(str(folder)) not in named:
                shutil.rmtree(folder, ignore_errors=True)
                total, gone = total - size, gone + 1
        return gone


def safe_name(text: str) -> str:
    """Return a file name for any text; different texts keep different names."""
    plain = _UNSAFE.sub("-", text)[:_LONGEST].strip("-")
    if plain == text:
        return text
    return f"{plain or 'x'}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
