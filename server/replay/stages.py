"""`<sensor>.stages.csv`: each sensor on its way through the preprocessing, one row per believed sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from server.nav.types import STAGE_COLUMNS, Kind
from server.replay.collect import Boot
from server.replay.contract_preprocessing import StagesOut
from server.replay.csv_out import number_table
from server.replay.output import Output
from server.replay.tables import T_NS

KIND_OF: Final = {"gyro": Kind.IMU, "accel": Kind.IMU, "mag": Kind.MAG, "baro": Kind.BARO, "airspeed": Kind.AIRSPEED}
_DELAY_OF: Final = {"gyro": "imu", "accel": "imu"}
"""Sensor → under which name the engine tells the delay of its filters."""


def stages_stem(sensor: str, place: int) -> str:
    """Return the file stem of a sensor's stages in the log's first (0), second (1), … power-up."""
    return f"{sensor}.stages" if place == 0 else f"{sensor}.stages.boot{place}"


def write_stages(output: Output, boots: Sequence[Boot]) -> None:
    """Write a file for each sensor that went through the chain, for each power-up."""
    for boot, sensor, stem in _files(boots):
        output.write(f"{stem}.csv", number_table((T_NS, *STAGE_COLUMNS[sensor]), *boot.stages(sensor)))


def stages_out(boots: Sequence[Boot]) -> dict[str, StagesOut]:
    """Return what was written, by file stem."""
    return {
        stem: StagesOut(
            file=f"{stem}.csv",
            sensor=sensor,
            boot_id=boot.boot_id,
            rows=len(boot.stages(sensor)[0]),
            delay_s=_delay_s(boot, sensor),
        )
        for boot, sensor, stem in _files(boots)
    }


def idle_chain(chain: Mapping[str, Mapping[str, float]], boots: Sequence[Boot]) -> list[str]:
    """Return a note for each sensor of which something was set and which the log does not have."""
    return [
        f"--preprocess {sensor}.…: the log has no {KIND_OF[sensor].name.lower()} samples, so nothing comes of it."
        for sensor in chain
        if not any(boot.samples[KIND_OF[sensor]] for boot in boots)
    ]


def _files(boots: Sequence[Boot]) -> Iterator[tuple[Boot, str, str]]:
    for place, boot in enumerate(boots):
        for sensor in STAGE_COLUMNS:
            if boot.has_stages(sensor):
                yield boot, sensor, stages_stem(sensor, place)


def _delay_s(boot: Boot, sensor: str) -> float:
    told = boot.snapshot.filter_delays if boot.snapshot is not None else ()
    return next((delay.delay_s for delay in told if delay.name == _DELAY_OF.get(sensor, sensor)), 0.0)
