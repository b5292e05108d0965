"""A folder of results: written beside its place and moved into it whole; nobody else's files are touched."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path

from server.replay.errors import ReplayError


def check_folder(place: Path, marker: str, format_name: str, *, overwrite: bool = False) -> None:
    """Return when results may go there: it is absent, empty, or holds an earlier result of the same kind.

    Args:
        place: the folder.
        marker: the JSON file that an earlier result left, with a key `format`.
        format_name: that key's value up to the slash.
        overwrite: other files may be there; they stay.

    Raises:
        ReplayError: it is a file, or somebody else's folder.
    """
    if not place.exists():
        return
    if not place.is_dir():
        raise ReplayError(f"{place} is a file. Give --out a directory.")
    if overwrite or not any(place.iterdir()) or _format_of(place / marker) == format_name:
        return
    raise ReplayError(
        f"{place} is not empty and holds no earlier {marker}. Give --out a new directory, or --overwrite to write into "
        "this one (files of other names stay)."
    )


def _format_of(path: Path) -> str:
    try:
        return str(json.loads(path.read_bytes())["format"]).partition("/")[0]
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def write_folder(place: Path, files: Mapping[str, bytes]) -> None:
    """Write every file beside the place, then move all of them in; an error leaves the place as it was.

    Raises:
        ReplayError: it cannot be written.
    """
    draft = place.absolute().parent / f".{place.name or 'compare'}.{secrets.token_hex(4)}.partial"
    try:
        draft.mkdir(parents=True)
        for name, content in files.items():
            (draft / name).write_bytes(content)
        place.mkdir(exist_ok=True)
        for name in files:
            os.replace(draft / name, place / name)
    except OSError as error:
        raise ReplayError(
            f"{place} cannot be written: {error.strerror}. Choose another --out or free some space."
        ) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
