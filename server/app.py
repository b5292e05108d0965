"""Composition root: builds the service from its settings, wires it, and owns the task group."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import importlib.metadata
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from typing import Any, Final

from fastapi import FastAPI

from server.api.application import make_app
from server.api.context import Context
from server.board import BoardParts
from server.boards import Boards
from server.calibration.service import Calibrations
from server.commands import AddBoard, Refusal
from server.doctor import Setup, examine
from server.door import Door, Names
from server.keyring import Keyring
from server.listener import BAD_INPUT, StartError, bound_socket, url_of
from server.live.live import Live
from server.live.socket import router as live_router
from server.metrics import Metrics
from server.nav.types import VehicleClass
from server.parts import KERNEL_MODULES, Factories, RealFactories
from server.quiet_server import QuietServer
from server.settings import LoadedSettings, Settings, settings_out
from server.view3d import View3D
from server.view3d import router as view3d_router
from server.wire_service import PortOut

log = logging.getLogger("navdeck")
SLOW_LOAD_S: Final = 3.0  # kernels that come from the cache take one


def version() -> str:
    """Return the version of the installed package."""
    return importlib.metadata.version("navdeck")


class Service:
    """Everything one process runs: boards, the page, the API, the stream and the 3D view."""

    def __init__(self, loaded: LoadedSettings, factories: Factories) -> None:
        settings = loaded.settings
        self.settings = settings
        self._factories = factories
        self._server: QuietServer | None = None
        self.boards = Boards(self._parts, settings.lanes, settings.history_s, settings.data_dir)
        self.calibrations = Calibrations(self.boards, settings.data_dir / "calibrations", version())
        self.live = Live(self.boards, self.calibrations.stream_text)
        self.metrics = Metrics(self.boards, lambda: self.live.clients, lambda: self.live.lost)
        self.boards.on_removed.append(self.metrics.forget)
        self.view3d = View3D(
            lambda: tuple(self.boards), lambda _board_id: vehicle_class(settings), scene_of=self.calibrations.scene
        )
        keyring = Keyring(_secret(settings, "token"), _secret(settings, "viewer_token"))
        self.context = Context(
            version=version(),
            boards=self.boards,
            calibrations=self.calibrations,
            keyring=keyring,
            registry=self.metrics.registry,
            settings=settings_out(loaded),
            list_ports=list_ports,
            doctor=lambda: examine(setup_of(loaded, listening=True)),
            view3d=settings.view3d,
        )
        more = [view3d_router(self.view3d)] if settings.view3d else []
        self.app = make_app(self.context, live_router, *more)
        self.app.state.live = self.live
        names = Names(loopback=settings.is_loopback, bound_host=settings.host, allowed=settings.allowed_hosts)
        self.asgi = Door(self.app, keyring, names)

    def _parts(self, command: AddBoard, board_id: str) -> BoardParts:
        return self._factories.parts(command, self.metrics.latency_of(board_id))

    async def add_links(self) -> None:
        """Make a board for each link of the settings; `StartError` for one that cannot be."""
        for url in self.settings.links:
            command = AddBoard(
                url=url,
                system=self.settings.mavlink_system,
                component=self.settings.mavlink_component,
                trusted=True,
            )
            reply = await self.boards.add(command)
            if isinstance(reply, Refusal):
                raise StartError(f"link = {url!r}: {reply.detail} Remedy: {reply.remedy}", BAD_INPUT)

    async def run(self, listener: socket.socket, on_started: Callable[[str], None]) -> None:
        """Serve until a signal or cancellation; every task of the service lives in this one group."""
        async with contextlib.AsyncExitStack() as stack:
            group = await stack.enter_async_context(asyncio.TaskGroup())
            self.calibrations.start(group)
            self.boards.start(group)
            self.live.start(group)
            stack.callback(self.calibrations.stop)
            stack.callback(self.live.stop)
            stack.callback(self.boards.stop)
            if self.settings.view3d:
                starting = group.create_task(self._start_view3d())
                stack.push_async_callback(self.view3d.stop)
                stack.callback(starting.cancel)
            self.context.ready = True
            self._server = QuietServer(self.asgi, lambda: on_started(url_of(listener)))
            await self._server.serve([listener])

    def stop(self) -> None:
        """Have `run` end."""
        if self._server is not None:
            self._server.should_exit = True

    async def _start_view3d(self) -> None:
        """Start the 3D view; without it the page still flies."""
        try:
            await self.view3d.start()
        except (ImportError, OSError, RuntimeError) as error:
            log.error("no 3D view: %s", error)


def bare_app() -> FastAPI:
    """Return the application with default settings and no board, for its OpenAPI."""
    loaded = LoadedSettings(settings=Settings.model_validate({}), sources={}, file=None)
    return Service(loaded, RealFactories(loaded.settings.engine_settings(), talk=False)).app


def serve(loaded: LoadedSettings, factories: Factories | None = None) -> None:
    """Run the service until SIGTERM or SIGINT.

    Raises:
        StartError: it cannot start.
    """
    settings = loaded.settings
    _check_door(settings)
    for name in loaded.unknown_variables:
        log.warning("%s is set, but there is no such setting", name)
    with contextlib.closing(bound_socket(settings.host, settings.port)) as listener, _quiet_signals():
        chosen = factories or RealFactories(settings.engine_settings(), talk=settings.talk)
        _load(chosen)
        _run(_main(loaded, chosen, listener))


def _load(factories: Factories) -> None:
    text = "compiling the kernels: once after an installation or an update, this takes some ten seconds"
    slow = threading.Timer(SLOW_LOAD_S, log.info, [text])
    slow.start()
    gc.disable()  # a full collection in the middle of loading pauses for a fifth of a second
    try:
        factories.load()
    except ValueError as error:
        raise StartError(f"{error}. Remedy: give another value; navdeck serve --help lists them.", BAD_INPUT) from None
    finally:
        slow.cancel()
        gc.freeze()  # what is loaded now stays: collections need not look at it again
        gc.enable()


async def _main(loaded: LoadedSettings, factories: Factories, listener: socket.socket) -> None:
    service = Service(loaded, factories)
    await service.add_links()
    await service.run(listener, lambda url: log.info("navdeck %s: %s", version(), url))


def _run(main: Coroutine[Any, Any, None]) -> None:
    """Run on uvloop where there is one: it costs less a wake-up."""
    factory: Callable[[], asyncio.AbstractEventLoop] | None = None
    if sys.platform != "win32":
        with contextlib.suppress(ImportError):
            import uvloop

            factory = uvloop.new_event_loop
    with asyncio.Runner(loop_factory=factory) as runner:
        runner.run(main)


def _check_door(settings: Settings) -> None:
    if not (settings.is_loopback or settings.has_token or settings.insecure):
        raise StartError(
            f"host = {settings.host!r} can be reached from other machines, and no token is set. Remedy: set "
            "NAVDECK_TOKEN (and NAVDECK_VIEWER_TOKEN for those who only look), or listen at 127.0.0.1, or, in a "
            "network that is all your own, say --insecure.",
            BAD_INPUT,
        )
    if settings.token is not None and settings.token == settings.viewer_token:
        raise StartError(
            "NAVDECK_TOKEN and NAVDECK_VIEWER_TOKEN are the same, so everybody who looks could also operate. "
            "Remedy: give two different tokens, or leave the viewer's out.",
            BAD_INPUT,
        )


@contextlib.contextmanager
def _quiet_signals() -> Iterator[None]:
    """Let a signal end the process with status 0 also while it starts, or at once while it stops.

    Raising is no way: it may strike inside a callback of the compiler, which swallows it. There is nothing to tidy
    up in these moments that the system does not do.
    """

    def stop(_number: int, _frame: object) -> None:
        os._exit(0)

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def vehicle_class(settings: Settings) -> VehicleClass:
    """Return the class of vehicle that was set; unknown takes the board's own word."""
    return settings.engine_settings().vehicle


def setup_of(loaded: LoadedSettings, *, listening: bool) -> Setup:
    """Return what the doctor looks at."""
    settings = loaded.settings
    tokens = (_secret(settings, "token"), _secret(settings, "viewer_token"))
    return Setup(
        host=settings.host,
        port=settings.port,
        loopback=settings.is_loopback,
        insecure=settings.insecure,
        listening=listening,
        token_lengths=tuple(len(token) for token in tokens if token),
        data_dir=settings.data_dir,
        unknown_variables=loaded.unknown_variables,
        list_ports=list_ports,
        kernel_modules=KERNEL_MODULES,
    )


def list_ports() -> Sequence[PortOut]:
    """Return the serial ports of this machine; blocks for some milliseconds."""
    from server import ports

    names = set(PortOut.model_fields)
    return tuple(PortOut(**{name: getattr(port, name) for name in names}) for port in ports.list_ports())


def _secret(settings: Settings, name: str) -> str | None:
    secret = getattr(settings, name)
    return None if secret is None else str(secret.get_secret_value())
