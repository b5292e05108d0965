"""A sensor folder or a .tlog as live takes it: raw samples, the magnetometer in gauss, the site from the log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from server.calibrate.columns import TEMPERATURE_PLACE
from server.calibrate.errors import CalibrateError
from server.calibrate.order import Piece
from server.calibrate.text import read_text
from server.calibration.feeding import runs
from server.magnetic import wmm_field
from server.nav.codes import FUSED
from server.nav.preprocess.check import PROVEN_SAMPLES, check_gnss, decade_scale
from server.nav.preprocess.memory import N_COUNTERS
from server.nav.site import SiteFinder
from server.nav.types import EngineSettings, Float, Kind, SampleBlock, Site
from server.replay.errors import ReplayError
from server.replay.options import merged
from server.replay.source import BLOCK_ROWS, LogInput, load

TEMPERATURE: Final = "temperature_degc"
PATIENCE: Final = 20
LIKELY_GAUSS: Final = (0.15, 1.5)
"""As `check_mag`: so many samples in a row outside of this decade, and the unit is looked for again."""
_NOW: Final = 1 << 62
"""After everything: the date has been waited for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Log:
    """What a log holds for a calibration.

    Attributes:
        pieces: raw samples in order of arrival, the magnetometer's in gauss.
        site: of its first 3-D fix or its meta.toml; None without either.
    """

    pieces: tuple[Piece, ...]
    site: Site | None
    notes: tuple[str, ...]


def is_log(path: Path) -> bool:
    """Tell whether a path is a log rather than a CSV file."""
    return path.is_dir() or path.suffix.lower() == ".tlog"


def read_log(path: Path) -> Log:
    """Return its samples.

    Raises:
        CalibrateError: it cannot be read, or holds no sample.
    """
    try:
        source = load(path)
        blocks = list(source.blocks(BLOCK_ROWS))
        settings = merged(source.overrides)
    except ReplayError as error:
        raise CalibrateError(str(error)) from error
    if path.is_dir():
        _add_temperatures(path, blocks)
    scale = 1.0 if path.is_dir() and says_gauss(blocks) else mag_scale(blocks)
    pieces = [Piece(kind=k, t_ns=t, rows=rows) for block in blocks for k, t, rows in runs(block, scale)]
    return Log(pieces=tuple(pieces), site=_site(blocks, settings), notes=tuple(_notes(source, scale, blocks)))


def mag_scale(blocks: Sequence[SampleBlock]) -> float:
    """Return the factor to gauss that the live preprocessing (`nav.preprocess.check`) finds; 0 = none."""
    scale, bad, good = 0.0, 0, 0
    for block in blocks:
        field = block.data[block.kind == Kind.MAG, :3]
        for norm in np.sqrt((field[np.isfinite(field).all(axis=1)] ** 2).sum(axis=1)).tolist():
            if scale == 0.0 or bad >= PATIENCE:
                scale, bad = decade_scale(norm), 0
            likely = LIKELY_GAUSS[0] <= norm * scale < LIKELY_GAUSS[1]
            bad, good = (0, good + 1) if likely else (bad + 1, good)
            if good >= PROVEN_SAMPLES:
                return scale
    return scale


def says_gauss(blocks: Sequence[SampleBlock]) -> bool:
    """Tell whether gauss, which a folder's columns are named, is likely for most samples: then the name is believed.

    The samples of a job are kept in gauss, and may begin where a magnet makes the first one unlikely.
    """
    norms = np.concatenate([np.linalg.norm(block.data[block.kind == Kind.MAG, :3], axis=1) for block in blocks] or [[]])
    likely = (norms >= LIKELY_GAUSS[0]) & (norms < LIKELY_GAUSS[1])
    return bool(2 * likely.sum() > np.isfinite(norms).sum())


def _add_temperatures(path: Path, blocks: Sequence[SampleBlock]) -> None:
    """Put in the temperatures that a job keeps beside its samples and a replay has no use for."""
    for kind, place in TEMPERATURE_PLACE.items():
        file = path / f"{kind.name.lower()}.csv"
        text = read_text(file) if file.is_file() else None
        if text is None or text.t_ns is None or TEMPERATURE not in text.names or not len(text.t_ns):
            continue
        known_ns, first = np.unique(text.t_ns, return_index=True)
        value = text.numbers[first, text.names.index(TEMPERATURE)]
        for block in blocks:
            mine = block.kind == kind
            block.data[mine, place] = value[np.searchsorted(known_ns, block.t_ns[mine]).clip(max=len(value) - 1)]


def _site(blocks: Sequence[SampleBlock], settings: EngineSettings) -> Site | None:
    """Return the site as the engine finds it."""
    finder = SiteFinder(settings, wmm_field)
    for block in blocks:
        dates = block.data[block.kind == Kind.DATE, 0]
        if dates.size and not np.isfinite(finder.board_year):
            finder.board_year = float(dates[0])
        if not finder.has_fix:
            _take_first_fix(finder, block)
    return finder.settle(_NOW)


def _take_first_fix(finder: SiteFinder, block: SampleBlock) -> None:
    counters = np.zeros(N_COUNTERS, dtype=np.int64)
    for at in np.flatnonzero(block.kind == Kind.GNSS):
        row: Float = block.data[at].copy()
        if check_gnss(row, counters) == FUSED and finder.take_fix(row[0], row[1], row[2], int(block.t_ns[at])):
            return


def _notes(source: LogInput, scale: float, blocks: Sequence[SampleBlock]) -> list[str]:
    found = [note for note in source.account().notes if not note.endswith(f"are ignored: {TEMPERATURE}")]
    if scale not in {0.0, 1.0}:
        found.append(
            f"The magnetometer is reported in another unit than gauss: its values are multiplied by {scale:g}."
        )
    boots = len({block.boot_id for block in blocks})
    if boots > 1:
        found.append(f"The board was powered up {boots} times in this log; what needs continuity starts again.")
    return found
