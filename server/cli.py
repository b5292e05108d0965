"""The command line: `navdeck [serve]`, ports, emulate, replay, doctor. Heavy parts are imported by who needs them."""

from __future__ import annotations

import importlib.metadata
import inspect
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn

import typer

BAD_INPUT: Final = 2
COMMANDS: Final = ("serve", "ports", "emulate", "replay", "doctor")
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


def say(text: str) -> None:
    """Write to standard output, which is what the command was asked for."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def refuse(text: str, status: int = BAD_INPUT) -> NoReturn:
    """Say why not on standard error, and end."""
    sys.stderr.write(f"navdeck: {text}\n")
    raise typer.Exit(status)


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

    def run(**flags: Any) -> None:  # noqa: ANN401
        config = flags.pop("config")
        command({name: value for name, value in flags.items() if value not in (None, [])}, config)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = command.__doc__
    return run


def _parameter(name: str, kind: object, option: object) -> inspect.Parameter:
    annotation = Annotated[kind, option]  # type: ignore[valid-type]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _load(flags: dict[str, Any], config: Path | None) -> Any:  # noqa: ANN401
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
    from server.app import serve
    from server.listener import StartError

    try:
        serve(loaded)
    except StartError as error:
        refuse(str(error), error.exit_status)


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
    overwrite: Annotated[bool, typer.Option("--overwrite", help="write into a folder that holds other files")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="no progress bar, no report")] = False,
) -> None:
    """Run a log through the very engine that runs live, as fast as it goes."""
    from server.replay.command import replay_command
    from server.replay.errors import ReplayError

    outages = tuple(gnss_outage or ())
    try:
        report = replay_command(
            log, out, lanes=lanes, gnss_outage=outages, nav_rate_hz=nav_rate_hz, overwrite=overwrite, quiet=quiet
        )
    except ReplayError as error:
        refuse(str(error))
    if report:
        say(report)


if __name__ == "__main__":
    main()
