"""`navdeck calibrate`: its options. The fits come when needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, cast

import typer

from server.cli_output import refuse, say

_NAN: Final = float("nan")


def calibrate(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="what to calibrate: mag_ellipsoid, gyro_bias, …")],
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="CSV files (- = stdin), a folder, a .tlog")],
    unit: Annotated[str, typer.Option(help="si or raw (any unit), for columns that name none")] = "",
    strength: Annotated[
        float, typer.Option(help="the field's strength [place's, else the radius becomes 1]", show_default=False)
    ] = _NAN,
    gravity: Annotated[
        float, typer.Option(help="local gravity, m/s² [place's, else 9.80665]", show_default=False)
    ] = _NAN,
    axis: Annotated[str, typer.Option(help="of the turntable: x, y or z [the one that turned most]")] = "",
    turns: Annotated[float, typer.Option(help="whole turns made [nearest whole number]", show_default=False)] = _NAN,
    rate_hz: Annotated[
        float, typer.Option(help="samples a second of data without time stamps [100]", show_default=False)
    ] = _NAN,
    ranges: Annotated[str, typer.Option(help="samples of the poses: a:b,c:d, JSON, or a JSON file")] = "",
    parameters: Annotated[int, typer.Option(help="of the ellipsoid: 6 axis-aligned, 9 tilted")] = 9,
    heading_deg: Annotated[float, typer.Option(help="true heading of the vehicle", show_default=False)] = _NAN,
    heading_sigma_deg: Annotated[float, typer.Option(help="how well that is known")] = 2.0,
    lat_deg: Annotated[float, typer.Option(help="place, for field and gravity [the log's]", show_default=False)] = _NAN,
    lon_deg: Annotated[float, typer.Option(help="place", show_default=False)] = _NAN,
    alt_m: Annotated[float, typer.Option(help="place [0]", show_default=False)] = _NAN,
    year: Annotated[
        float, typer.Option(help="date of the magnetic model, as 2026.9 [its epoch]", show_default=False)
    ] = _NAN,
    height_m: Annotated[float, typer.Option(help="what the barometer shall read", show_default=False)] = _NAN,
    duration_s: Annotated[float, typer.Option(help="how much to use [the kind's own]", show_default=False)] = _NAN,
    columns: Annotated[str, typer.Option(metavar="A,B,…", help="column names of files without a header")] = "",
    verify: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="check on fresh data (repeatable)")] = None,
    applied: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="earlier results to apply first, for level, heading, flight"),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="write the JSON here too")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON instead of a table")] = False,
) -> None:
    """Calibrate a sensor from files, as live does it. Exit status: 0 fitted, 3 refused, 2 bad input."""
    from server.calibrate import command
    from server.calibrate.errors import CalibrateError
    from server.calibrate.told import Told, kind_of

    try:
        told = Told(
            kind=kind_of(kind),
            files=tuple(files),
            unit=cast(Any, unit),
            strength=strength,
            gravity_m_s2=gravity,
            axis=cast(Any, axis),
            turns=turns,
            rate_hz=rate_hz,
            ranges=ranges,
            parameters=parameters,
            heading_deg=heading_deg,
            heading_sigma_deg=heading_sigma_deg,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            year=year,
            height_m=height_m,
            duration_s=duration_s,
            columns=tuple(name for name in columns.split(",") if name.strip()),
            verify=tuple(verify or ()),
            applied=tuple(applied or ()),
        )
        answer = command.run(told, as_json=as_json, out=out)
    except CalibrateError as error:
        refuse(str(error))
    say(answer.text)
    raise typer.Exit(answer.status)
