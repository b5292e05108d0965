"""A sensor folder or a .tlog as live takes it: raw samples, the magnetometer in gauss, the site from the log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from server.calibrate.errors import CalibrateError
from server.calibrate.order import Piece
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
    scale = mag_scale(blocks)
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
    found = list(source.account().notes)
    if scale not in {0.0, 1.0}:
        found.append(
            f"The magnetometer is reported in another unit than gauss: its values are multiplied by {scale:g}."
        )
    boots = len({block.boot_id for block in blocks})
    if boots > 1:
        found.append(f"The board was powered up {boots} times in this log; what needs continuity starts again.")
    return found
