"""CSV files to what collectors take: stretches of samples of one kind, in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from server.calibrate.columns import (
    AXES,
    BARE_TIMES,
    MAIN_KIND,
    NAMES,
    NEEDED,
    SENSOR_OF_XYZ,
    SI_UNITS,
    TEMPERATURE_PLACE,
    TIMES,
    Target,
    accepted,
    looks_like,
)
from server.calibrate.errors import CalibrateError
from server.calibrate.order import Piece, Stamped, in_order
from server.calibrate.text import Text, read_text
from server.calibrate.told import Told
from server.nav.types import ROW_WIDTH, Float, Int, Kind
from server.replay.errors import nearest

DEFAULT_RATE_HZ: Final = 100.0
_KINDS_OF: Final = {target.sensor: target.kind for target in NAMES.values()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """All files.

    Attributes:
        pieces: in the order in which collectors take them.
        has_stamps: False when the rate was assumed or told.
    """

    pieces: tuple[Piece, ...]
    has_stamps: bool
    notes: tuple[str, ...]


def read_csvs(paths: Sequence[Path], told: Told) -> Samples:
    """Return the samples of CSV files, one after the other, or side by side where they are of different sensors.

    Raises:
        CalibrateError: a file, a column or a cell is not usable, or no file has what the kind needs.
    """
    notes: list[str] = []
    files: list[Stamped] = []
    counted: dict[Kind, int] = {}
    for path in paths:
        text = read_text(path, told.columns)
        files.append(_stamped(text, told, counted, notes))
    _check_needed(files, told)
    if any(file.has_stamps for file in files) and np.isfinite(told.rate_hz):
        notes.append("The files have time stamps; --rate-hz is not used for them.")
    kinds = {_KINDS_OF[sensor] for group in NEEDED[told.kind] for sensor in group}
    whole = all(file.has_stamps for file in files)
    return Samples(pieces=tuple(in_order(files, kinds)), has_stamps=whole, notes=tuple(dict.fromkeys(notes)))


def _stamped(text: Text, told: Told, counted: dict[Kind, int], notes: list[str]) -> Stamped:
    """Return one file's pieces; `counted` is how many samples without stamps each kind has had before."""
    notes.extend(text.notes)
    names = text.names or _names_without_header(text, told, notes)
    targets = _targets(text.path, names, told, notes)
    t_ns = _times(text, names, notes)
    n = len(text.numbers)
    pieces = {}
    for kind in sorted({target.kind for target in targets.values()}):
        rows = np.full((n, ROW_WIDTH), np.nan)
        for column, target in targets.items():
            if target.kind is kind:
                rows[:, target.place] = _converted(text.numbers[:, column], target, told)
        stamps = t_ns if t_ns is not None else _counted_stamps(n, counted.get(kind, 0), told)
        counted[kind] = counted.get(kind, 0) + n
        pieces[kind] = Piece(kind=kind, t_ns=stamps, rows=rows)
    sensors = frozenset(target.sensor for target in targets.values())
    return Stamped(path=text.path, sensors=sensors, pieces=pieces, has_stamps=t_ns is not None)


def _converted(cells: Float, target: Target, told: Told) -> Float:
    """Return the column in SI, or as it stands when the unit is raw, which is said of the calibrated sensor."""
    if told.unit == "raw" and target.kind is MAIN_KIND[told.kind] and target.sensor != "temperature":
        return cells
    return cells if (target.factor, target.shift) == (1.0, 0.0) else cells * target.factor + target.shift


def _names_without_header(text: Text, told: Told, notes: list[str]) -> tuple[str, ...]:
    width = text.numbers.shape[1]
    if width == len(AXES) and told.unit == "raw" and told.kind in SENSOR_OF_XYZ:
        notes.append(f"{text.path}: no header; its three columns are taken as x,y,z of the {_sensor_of_xyz(told)}.")
        return tuple(AXES)
    raise CalibrateError(
        f"{text.path}: the first line is all numbers and names no column ({width} columns). Put a header line first, "
        f"for example {_example(told)}, or give --columns with {width} names."
        + (" Three columns are taken as x,y,z with --unit raw." if width == len(AXES) else "")
    )


def _sensor_of_xyz(told: Told) -> str:
    return SENSOR_OF_XYZ[told.kind]


def _example(told: Told) -> str:
    sensor = NEEDED[told.kind][0][0]
    mine = [name for name, target in NAMES.items() if target.sensor == sensor and target.unit and target.factor == 1.0]
    return ",".join(("t_ns", *list(dict.fromkeys(mine))[: 1 if sensor not in SENSOR_OF_XYZ.values() else 9]))


def _targets(path: Path, names: Sequence[str], told: Told, notes: list[str]) -> dict[int, Target]:
    """Return column → where it goes, for every column that means something."""
    found: dict[int, Target] = {}
    needed = {sensor for group in NEEDED[told.kind] for sensor in group}
    strange = []
    for column, name in enumerate(names):
        target = _target(name, told)
        if target is not None:
            _check_unit(path, name, target, told, needed)
            found[column] = target
        elif name not in TIMES and name not in BARE_TIMES:
            sensor = looks_like(name)
            if sensor in needed:
                raise CalibrateError(
                    f"{path}: column {name} is not known{nearest(name, NAMES)}. Accepted: {accepted(sensor)}."
                )
            strange.append(name or f"number {column + 1}")
    if strange:
        notes.append(f"{path}: columns that are not used: {', '.join(strange)}.")
    _check_once(path, names, found)
    used = {column: target for column, target in found.items() if told.unit or target.unit or target.sensor in needed}
    return _with_temperature(used)


def _with_temperature(targets: dict[int, Target]) -> dict[int, Target]:
    """Give the temperature to the first of IMU, barometer and airspeed that the file has; to none, it is not used."""
    kinds = {target.kind for target in targets.values() if target.sensor != "temperature"}
    owner = next((kind for kind in TEMPERATURE_PLACE if kind in kinds), None)
    out = {column: target for column, target in targets.items() if target.sensor != "temperature"}
    for column, target in targets.items():
        if target.sensor == "temperature" and owner is not None:
            out[column] = replace(target, kind=owner, place=TEMPERATURE_PLACE[owner])
    return out


def _target(name: str, told: Told) -> Target | None:
    if name in tuple(AXES) and told.kind in SENSOR_OF_XYZ:
        return NAMES[f"{_sensor_of_xyz(told)}_{name}"]
    return NAMES.get(name)


def _check_unit(path: Path, name: str, target: Target, told: Told, needed: set[str]) -> None:
    if target.sensor in needed and not target.unit and not told.unit:
        si = SI_UNITS.get(target.sensor, "m")
        raise CalibrateError(
            f"{path}: column {name} says no unit. Give --unit si when it is in {si}, --unit raw for any other, "
            f"or name the unit: {accepted(target.sensor)}."
        )


def _check_once(path: Path, names: Sequence[str], found: dict[int, Target]) -> None:
    """Raise CalibrateError when two columns mean the same value."""
    seen: dict[tuple[Kind, int], str] = {}
    for column, target in found.items():
        other = seen.setdefault((target.kind, target.place), names[column])
        if other != names[column] or list(names).count(other) > 1:
            raise CalibrateError(
                f"{path}: columns {other} and {names[column]} are both {target.sensor}'s. Keep one of them."
            )


def _times(text: Text, names: Sequence[str], notes: list[str]) -> Int | None:
    """Return the stamps in ns; None when the file has none."""
    known = sorted((name for name in names if name in TIMES), key=list(TIMES).index)
    bare = [name for name in names if name in BARE_TIMES]
    if known and len(known) + len(bare) > 1:
        notes.append(f"{text.path}: time is taken from {known[0]}.")
    if not known and not bare:
        _refuse_strange_time(text.path, names)
        return None
    name = known[0] if known else bare[0]
    if name == "t_ns" and text.t_ns is not None:
        return text.t_ns
    cells = text.numbers[:, list(names).index(name)]
    if not np.isfinite(cells).all() or (np.abs(cells) * TIMES.get(name, 1e9) >= 2.0**63).any():
        row = int(np.argmax(~np.isfinite(cells)))
        raise CalibrateError(
            f"{text.path}: column {name}, sample {row}: {cells[row]} is no time. Every sample needs one."
        )
    scale = TIMES[name] if known else _bare_scale(text.path, name, cells, notes)
    found: Int = np.rint(cells * scale).astype(np.int64)
    return found


def _bare_scale(path: Path, name: str, cells: Float, notes: list[str]) -> float:
    """Seconds is the only unit in which samples are less than 1 apart."""
    steps = np.diff(cells)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if 0.0 < step < 1.0:
        notes.append(f"{path}: column {name} says no unit; its steps of {step:.4g} are taken as seconds.")
        return 1e9
    raise CalibrateError(
        f"{path}: column {name} says no unit and its steps of {step:.4g} do not tell. Name it {accepted('time')}."
    )


def _refuse_strange_time(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if looks_like(name) == "time":
            raise CalibrateError(f"{path}: column {name} is not known. Accepted for time: {accepted('time')}.")


def _counted_stamps(n: int, before: int, told: Told) -> Int:
    rate_hz = told.rate_hz if np.isfinite(told.rate_hz) else DEFAULT_RATE_HZ
    found: Int = np.rint(np.arange(before, before + n) * (1e9 / rate_hz)).astype(np.int64)
    return found


def _check_needed(files: Sequence[Stamped], told: Told) -> None:
    """Raise CalibrateError when no file has a sensor that the kind cannot do without, or only some of its axes."""
    for group in NEEDED[told.kind]:
        having = [file for file in files if file.sensors & set(group)]
        if not having:
            raise CalibrateError(
                f"{', '.join(str(file.path) for file in files)}: no column of {' or '.join(group)}, which "
                f"{told.kind.value} needs. Accepted: {'; '.join(accepted(sensor) for sensor in group)}."
            )
        for file in having:
            _check_axes(file, [sensor for sensor in group if sensor in file.sensors])


def _check_axes(file: Stamped, sensors: Sequence[str]) -> None:
    for sensor in sensors:
        places = [t.place for t in NAMES.values() if t.sensor == sensor]
        rows = file.pieces[_KINDS_OF[sensor]].rows
        first, last = min(places), max(places)
        absent = [AXES[k] for k in range(last - first + 1) if len(rows) and np.isnan(rows[:, first + k]).all()]
        if absent and last > first:
            raise CalibrateError(
                f"{file.path}: {sensor} has no {', '.join(absent)}. Three axes are needed: {accepted(sensor)}."
            )
