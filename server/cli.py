"""The command line: `navdeck [serve]`, emulate, replay, compare, montecarlo, … Heavy parts come when needed."""

from __future__ import annotations

import importlib.metadata
import inspect
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from server.cli_calibrate import calibrate
from server.cli_output import refuse, say

GLOBAL_FLAGS: Final = ("--help", "--version")
MARKS: Final = {"ok": "ok     ", "caution": "caution", "problem": "PROBLEM"}

app = typer.Typer(
    help="Live navigation from a flight board. Without a command: serve.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Run the command line; `serve` is what it does when no command is named."""
    args = sys.argv[1:]
    if not args or (args[0].startswith("-") and args[0] not in GLOBAL_FLAGS):
        args = ["serve", *args]
    app(args, prog_name="navdeck")


def _show_version(asked: bool) -> None:
    if asked:
        say(f"navdeck {importlib.metadata.version('navdeck')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show it.")] = False,
) -> None:
    """Live navigation from a flight board. Without a command: serve."""


def with_settings(command: Callable[[dict[str, Any], Path | None], None]) -> Callable[..., None]:
    """Give a command one flag for each setting, described where the setting is."""
    from server.settings import Settings, default_text, flag_of

    config_help = "settings file; else ./navdeck.toml, then ~/.config/navdeck/navdeck.toml"
    parameters = [_parameter("config", Path | None, typer.Option("--config", help=config_help))]
    for name, field in Settings.model_fields.items():
        text, flag = f"{field.description} [{default_text(name)}]", flag_of(name)
        if field.annotation is bool:
            option = typer.Option(f"{flag}/--no-{flag.removeprefix('--')}", help=text)
            parameters.append(_parameter(name, bool | None, option))
        elif str(field.annotation).startswith("tuple[str"):
            option = typer.Option(flag, help=f"{text} (repeatable)", metavar="TEXT")
            parameters.append(_parameter(name, list[str] | None, option))
        else:
            parameters.append(_parameter(name, str | None, typer.Option(flag, help=text, metavar="VALUE")))

    def run(**flags: Any) -> None:  # noqa: ANN401  # one per setting, each of its own type
        config = flags.pop("config")
        command({name: value for name, value in flags.items() if value not in (None, [])}, config)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = command.__doc__
    return run


def _parameter(name: str, kind: object, option: object) -> inspect.Parameter:
    annotation = Annotated[kind, option]  # type: ignore[valid-type]  # made at run time, for typer
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _load(flags: dict[str, Any], config: Path | None) -> Any:  # noqa: ANN401  # Settings, imported late
    from server.settings import SettingsError, load_settings

    try:
        return load_settings(flags, config)
    except SettingsError as error:
        refuse(str(error))


def _serve(flags: dict[str, Any], config: Path | None) -> None:
    """Run the service: page, API, 3D view. Settings: flags, then NAVDECK_*, then the file."""
    loaded = _load(flags, config)
    level = logging.getLevelNamesMapping()[loaded.settings.log_level.upper()]
    logging.basicConfig(level=level, format="%(asctime)s %(levelname)s %(name)s: %(message)s", stream=sys.stderr)
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    logging.getLogger("websockets").setLevel(logging.WARNING)
    _warn_of_weak_tokens(loaded.settings)
    from server.app import serve
    from server.listener import StartError

    try:
        serve(loaded)
    except StartError as error:
        refuse(str(error), error.exit_status)


def _warn_of_weak_tokens(settings: Any) -> None:  # noqa: ANN401  # Settings, imported late
    from server.doctor import TOKEN_SHORT

    for name in ("token", "viewer_token"):
        secret = getattr(settings, name)
        if secret is not None and len(secret.get_secret_value()) < TOKEN_SHORT:
            text = "the %s has fewer than %d characters and can be guessed; make another: openssl rand -hex 16"
            logging.getLogger("navdeck").warning(text, name.replace("_", " "), TOKEN_SHORT)


def _doctor(flags: dict[str, Any], config: Path | None) -> None:
    """Say what is wrong with this set-up and what to do about it; status 1 when something is."""
    loaded = _load(flags, config)
    from server.app import setup_of
    from server.doctor import examine

    report = examine(setup_of(loaded, listening=False))
    for check in report.checks:
        say(
            f"{MARKS[check.state]}  {check.name}: {check.cause}" + (f"\n         → {check.remedy}" * bool(check.remedy))
        )
    raise typer.Exit(1 if report.state == "problem" else 0)


app.command("serve")(with_settings(_serve))
app.command("doctor")(with_settings(_doctor))


@app.command()
def ports() -> None:
    """List the serial ports of this machine and why each one cannot be used."""
    from server.ports import list_ports

    found = list_ports()
    if not found:
        say("No serial port. Plug a board in with a data cable; without one, try the demo: navdeck")
    for port in found:
        say(f"{port.url}\n    {port.description or port.device}" + ("" if port.usable else f"\n    {port.cause}"))
        if port.remedy:
            say(f"    → {port.remedy}")


@app.command()
def emulate(
    log: Annotated[Path, typer.Argument(metavar="LOG.tlog", help="the recorded serial stream")],
    speed: Annotated[float, typer.Option(help="board seconds per second; 0 = as fast as it is read")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="begin again at the end")] = False,
    now: Annotated[bool, typer.Option("--now", help="do not wait for the first byte of a reader")] = False,
    link: Annotated[Path | None, typer.Option(help="a stable name: a symbolic link made here")] = None,
) -> None:
    """Be a board on the desk: a pseudo-terminal that says what a recorded board said, at its pace."""
    from server.emulate import emulate as play

    try:
        stats = play(log, speed=speed, loop=loop, now=now, link=link, on_ready=lambda board: say(board.device))
    except (OSError, ValueError) as error:
        refuse(str(error))
    except KeyboardInterrupt:
        raise typer.Exit from None
    sys.stderr.write(f"navdeck: {stats.bytes_sent} bytes sent\n")


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="a .tlog, or a folder of sensor CSVs")],
    out: Annotated[Path, typer.Option(help="folder for <lane>.csv and summary.json")],
    lanes: Annotated[str, typer.Option(help="estimators, as a,b or all")] = "all",
    gnss_outage: Annotated[
        list[str] | None, typer.Option(metavar="A:B", help="withhold GNSS valid in [A, B) s after the first sample")
    ] = None,
    nav_rate_hz: Annotated[float | None, typer.Option(help="navigation steps a second")] = None,
    lane_values: Annotated[
        list[str] | None, typer.Option("--set", metavar="LANE.PARAMETER=VALUE", help="a number of an estimator")
    ] = None,
    preprocess: Annotated[
        list[str] | None,
        typer.Option(metavar="SENSOR.PARAMETER=VALUE", help="units, mounting or filter of a sensor (repeatable)"),
    ] = None,
    calibration: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="navdeck's JSON, in force from the first sample (repeatable)"),
    ] = None,
    mag_learning: Annotated[
        str | None, typer.Option(metavar="run|apply", help="learn the magnetic offset; apply = take it off too")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="write into a folder that holds other files")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="no progress bar, no report")] = False,
) -> None:
    """Run a log through the very engine that runs live, as fast as it goes."""
    from server.replay.command import replay_command
    from server.replay.errors import ReplayError

    try:
        report = replay_command(
            log,
            out,
            lanes=lanes,
            gnss_outage=tuple(gnss_outage or ()),
            nav_rate_hz=nav_rate_hz,
            lane_values=tuple(lane_values or ()),
            preprocess=tuple(preprocess or ()),
            calibrations=tuple(calibration or ()),
            mag_learning=mag_learning,
            overwrite=overwrite,
            quiet=quiet,
        )
    except ReplayError as error:
        refuse(str(error))
    if report:
        say(report)


@app.command()
def compare(
    log: Annotated[Path | None, typer.Argument(metavar="[LOG]", help="a .tlog, or a folder of sensor CSVs")] = None,
    five_motions: Annotated[bool, typer.Option("--five-motions", help="motions with their truth, no log")] = False,
    lanes: Annotated[str, typer.Option(help="estimators, as a,b or all")] = "all",
    to: Annotated[str, typer.Option("--to", metavar="LANE", help="differences are to this one")] = "ins_ekf",
    reference: Annotated[
        str | None, typer.Option(metavar="LANE", help="errors are against this one [the log's reference, else onboard]")
    ] = None,
    lane_values: Annotated[
        list[str] | None, typer.Option("--set", metavar="LANE.PARAMETER=VALUE", help="a number of an estimator")
    ] = None,
    gnss_outage: Annotated[
        list[str] | None, typer.Option(metavar="A:B", help="withhold GNSS valid in [A, B) s after the first sample")
    ] = None,
    window: Annotated[
        list[str] | None, typer.Option(metavar="A:B", help="figures and plots of this stretch too, s")
    ] = None,
    nav_rate_hz: Annotated[float | None, typer.Option(help="navigation steps a second")] = None,
    seed: Annotated[int | None, typer.Option(help="of the motions' noise [1]")] = None,
    out: Annotated[Path | None, typer.Option(help="folder for report.html and the figures as JSON")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="write into a folder that holds other files")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the figures as JSON instead of tables")] = False,
) -> None:
    """Run every estimator on the very same samples: differences, errors, delay, noise, cost."""
    from server.compare import command
    from server.replay.errors import ReplayError

    told = command.Told(
        log=log,
        five_motions=five_motions,
        lanes=lanes,
        chosen=to,
        reference=reference,
        parameters=tuple(lane_values or ()),
        gnss_outages=tuple(gnss_outage or ()),
        windows=tuple(window or ()),
        nav_rate_hz=nav_rate_hz,
        seed=seed,
        out=out,
        overwrite=overwrite,
        as_json=as_json,
    )
    try:
        text = command.run(told)
    except ReplayError as error:
        refuse(str(error))
    say(text)


@app.command()
def montecarlo(
    runs: Annotated[int, typer.Option(help="flights")] = 100,
    seconds: Annotated[float, typer.Option(help="length of each, s")] = 240.0,
    seed: Annotated[int, typer.Option(help="equal seeds give equal results")] = 1,
    told: Annotated[
        str,
        typer.Option(help="what the filter knows of the board: sheet = its data sheets, or the product's defaults"),
    ] = "sheet",
    rtk: Annotated[bool, typer.Option("--rtk", help="fly with a carrier-phase receiver")] = False,
    out: Annotated[Path | None, typer.Option(help="folder for montecarlo.json and montecarlo.html")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the figures as JSON instead of a table")] = False,
) -> None:
    """Fly the demo board many times, each with other errors: are the filter's errors as large as it says?"""
    from server.montecarlo import command as campaign

    try:
        chosen = campaign.checked(runs=runs, seconds=seconds, seed=seed, told=told, rtk=rtk)
        found = campaign.montecarlo(chosen, out=out)
    except campaign.CampaignError as error:
        refuse(str(error))
    say(campaign.as_json(found).decode().rstrip() if as_json else campaign.report(found, out))


app.command()(calibrate)


if __name__ == "__main__":
    main()
