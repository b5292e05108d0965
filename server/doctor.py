"""What is wrong with this set-up: each check with its cause and remedy. It looks and changes nothing."""

from __future__ import annotations

import importlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from server.api.pages import WEB_DIST
from server.listener import listening_socket
from server.wire_service import CheckOut, DoctorOut, PortOut

State = Literal["ok", "caution", "problem"]
PYTHON_MIN: Final = (3, 11)
DISK_LOW_BYTES: Final = 1_000_000_000  # an hour of a board at 92 kB/s is 330 MB
DISK_FULL_BYTES: Final = 100_000_000
TOKEN_SHORT: Final = 16  # characters; fewer can be guessed where guessing is not limited, as from many addresses
BUILT_AFTER_S: Final = 1_735_689_600  # 2025-01-01: a clock before it was never set
STATES: Final[tuple[State, ...]] = ("ok", "caution", "problem")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What the doctor looks at; filled from the settings by `app`.

    Attributes:
        listening: this very process holds the port, so it is not free and need not be.
        token_lengths: of the tokens that are configured.
    """

    host: str
    port: int
    loopback: bool
    insecure: bool
    listening: bool
    token_lengths: tuple[int, ...]
    data_dir: Path
    unknown_variables: tuple[str, ...]
    list_ports: Callable[[], Sequence[PortOut]]
    kernel_modules: tuple[str, ...]


def examine(setup: Setup) -> DoctorOut:
    """Return every check; the state of the whole is that of its worst."""
    found: list[CheckOut] = []
    for checks in (_python, _page, _kernels, _port, _door, _serial, _data, _clock, _variables):
        found += checks(setup)
    return DoctorOut(state=max((one.state for one in found), key=STATES.index), checks=tuple(found))


def _check(name: str, state: State, cause: str, remedy: str = "") -> CheckOut:
    return CheckOut(name=name, state=state, cause=cause, remedy=remedy)


def _python(_: Setup) -> Iterator[CheckOut]:
    version = ".".join(map(str, sys.version_info[:3]))
    old = sys.version_info < PYTHON_MIN
    remedy = f"Install Python {'.'.join(map(str, PYTHON_MIN))} or newer." if old else ""
    yield _check("python", "problem" if old else "ok", f"Python {version} at {sys.executable}.", remedy)


def _page(_: Setup) -> Iterator[CheckOut]:
    if (WEB_DIST / "index.html").is_file():
        yield _check("page", "ok", "The page is built into the package.")
    else:
        yield _check("page", "problem", "The page was not built; the API works.", "Run ./run in the checkout.")


def _kernels(setup: Setup) -> Iterator[CheckOut]:
    try:
        for name in setup.kernel_modules:
            importlib.import_module(name)
    except ImportError as error:
        yield _check("kernels", "problem", f"A part of the core cannot be loaded: {error}.", "Install navdeck again.")
        return
    from server.kernel_cache import kernel_stats

    stats = kernel_stats()
    if stats.compiled:
        cause = f"{stats.compiled} kernels had to be compiled now, {stats.cached} came from the cache: starts are slow."
        yield _check("kernels", "caution", cause, "Run python -m server.warm once, as a user who may write there.")
    else:
        yield _check("kernels", "ok", f"{stats.cached} compiled kernels are in the cache.")


def _port(setup: Setup) -> Iterator[CheckOut]:
    where = f"{setup.host}:{setup.port}"
    if setup.listening:
        yield _check("port", "ok", f"This service listens at {where}.")
        return
    try:
        listening_socket(setup.host, setup.port).close()
    except OSError as error:
        remedy = f"Stop the program that holds it, or choose another: navdeck --port {setup.port + 1}."
        yield _check("port", "problem", f"{where} cannot be used: {error.strerror}.", remedy)
    else:
        yield _check("port", "ok", f"{where} is free.")


def _door(setup: Setup) -> Iterator[CheckOut]:
    if any(length < TOKEN_SHORT for length in setup.token_lengths):
        remedy = "Make one with: openssl rand -hex 16."
        yield _check("token", "caution", f"A token has fewer than {TOKEN_SHORT} characters.", remedy)
    elif setup.token_lengths:
        yield _check("token", "ok", "Tokens are set.")
    elif setup.loopback:
        yield _check("token", "ok", "Only this machine can reach the service; no token is needed.")
    elif setup.insecure:
        remedy = "Set NAVDECK_TOKEN, unless the network is your own."
        yield _check("token", "caution", f"Anybody who reaches {setup.host} may operate the boards.", remedy)
    else:
        cause = f"The service refuses to start at {setup.host} without a token."
        yield _check("token", "problem", cause, "Set NAVDECK_TOKEN, or listen at 127.0.0.1.")


def _serial(setup: Setup) -> Iterator[CheckOut]:
    ports = setup.list_ports()
    if not ports:
        yield _check("serial ports", "caution", "No serial port is there.", "Plug a board in; the demo needs none.")
    for port in ports:
        state: State = "ok" if port.usable or port.code == "in-use-here" else "problem"
        cause = port.cause or f"{port.description or 'A serial port'} can be used."
        yield _check(f"port {port.device}", state, cause, port.remedy if state != "ok" else "")


def _data(setup: Setup) -> Iterator[CheckOut]:
    folder = next(path for path in (setup.data_dir, *setup.data_dir.parents) if path.exists())
    if not os.access(folder, os.W_OK):
        remedy = "Choose another with --data-dir, or allow this user to write there."
        yield _check("data folder", "problem", f"{folder} cannot be written.", remedy)
        return
    free = shutil.disk_usage(folder).free
    state: State = "problem" if free < DISK_FULL_BYTES else "caution" if free < DISK_LOW_BYTES else "ok"
    remedy = "" if state == "ok" else "Make room, or choose another disk with --data-dir."
    yield _check("data folder", state, f"{setup.data_dir}: {free / 1e9:.1f} GB are free.", remedy)


def _clock(_: Setup) -> Iterator[CheckOut]:
    if time.time() < BUILT_AFTER_S:
        cause = "This machine's date is in the past; certificates and file dates will be wrong."
        yield _check("clock", "caution", cause, "Set the date, or let it be set: timedatectl set-ntp true.")
    else:
        yield _check("clock", "ok", time.strftime("It is %Y-%m-%d %H:%M UTC.", time.gmtime()))


def _variables(setup: Setup) -> Iterator[CheckOut]:
    for name in setup.unknown_variables:
        yield _check(name, "caution", f"{name} is set, but there is no such setting.", "See navdeck serve --help.")
