"""The 3D view of every board: one viser server on loopback, one scene per viewer, work only while somebody looks.

Why one server and a scene per client (`client.scene`) rather than a shared scene: every viewer has its own board,
theme, path colours and anchor; a stranger who finds the loopback port sees nothing; per-client messages are not kept
for replay, so there is no broadcast buffer to bound.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable, Coroutine, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from server.nav.types import VehicleClass
from server.view3d.feed import BoardFeed
from server.view3d.stage import Stage
from server.view3d.trail import Track
from server.view3d.viewer import ViewCommand, Viewer, Wishes

if TYPE_CHECKING:
    import viser

    from server.calibration.scene import CalibrationScene

log = logging.getLogger("navdeck.view3d")
SAMPLE_S: Final = 0.2
SAMPLES_UNWATCHED: Final = 2  # a board nobody looks at is read every so many samples
HOP_BUFFER_BYTES: Final = 64 * 1024
"""Kernel buffer between viser and us, each side: by default 4 MB of stale scene could queue there, a minute's worth."""

MAX_VIEWERS: Final = 16  # the next one is refused (1013): each costs a few per cent of a core


def _unknown_class(_board_id: str) -> VehicleClass:
    return VehicleClass.UNKNOWN


class View3D:
    """Owns the viser server. `start` and `stop` once each; everything else from the event loop of `start`."""

    def __init__(
        self,
        boards: Callable[[], Sequence[BoardFeed]],
        vehicle_of: Callable[[str], VehicleClass] = _unknown_class,
        scene_of: Callable[[str], CalibrationScene | None] | None = None,
    ) -> None:
        self._boards = boards
        self._vehicle_of = vehicle_of
        self._scene_of = scene_of
        self._server: viser.ViserServer | None = None
        self._tracks: dict[str, Track] = {}
        self._stages: dict[str, tuple[Stage, asyncio.Task[None]]] = {}
        self._expected: dict[int, Viewer] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def start(self) -> None:
        """Build the viser server in a thread and begin to keep the paths."""
        loop = asyncio.get_running_loop()
        self._server = await asyncio.to_thread(_build_server)

        async def on_client(client: viser.ClientHandle) -> None:
            port = _admit_connection(client)
            loop.call_soon_threadsafe(self._greet, port, client)

        self._server.on_client_connect(on_client)
        self._spawn(self._sample_forever())

    async def stop(self) -> None:
        """End everything; open sockets close."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._stages.clear()
        server, self._server = self._server, None
        if server is not None:
            await asyncio.to_thread(_stop_server, server)

    @property
    def upstream_url(self) -> str | None:
        """WebSocket URL of the viser server on loopback; None while it does not run."""
        return None if self._server is None else f"ws://127.0.0.1:{self._server.get_port()}"

    @property
    def client_html(self) -> Path:
        """The browser half of viser, one self-contained file."""
        import viser

        return Path(viser.__file__).parent / "client" / "build" / "index.html"

    @property
    def viewers(self) -> int:
        """How many browsers look now."""
        return len(self._expected)

    @contextlib.contextmanager
    def session(self, wishes: Wishes, local_port: int) -> Iterator[Viewer]:
        """Hold a viewer whose upstream socket has this local port; when it ends, nothing of it remains."""
        viewer = Viewer(wishes)
        self._expected[local_port] = viewer
        self._seat(viewer)
        try:
            yield viewer
        finally:
            self._expected.pop(local_port, None)
            viewer.detach()
            self._unseat(viewer)

    def command(self, viewer: Viewer, command: ViewCommand) -> None:
        """Do what the viewer's page asked."""
        if command.board is not None and command.board != viewer.wishes.board:
            self._unseat(viewer)
            viewer.wishes.board = command.board
            viewer.forget_board()
            self._seat(viewer)
        stage = self._stage_of(viewer)
        viewer.obey(command, None if stage is None else stage.track)
        if command.visible and stage is not None:
            stage.welcome(viewer)

    def _greet(self, port: int, client: viser.ClientHandle) -> None:
        viewer = self._expected.get(port)
        if viewer is None:
            return
        stage = self._stage_of(viewer)
        viewer.attach(client, VehicleClass.UNKNOWN if stage is None else stage.kind)
        if stage is not None:
            stage.welcome(viewer)

    def _seat(self, viewer: Viewer) -> None:
        board = self._board(viewer.wishes.board)
        if board is None:
            return  # the sampler tries again
        if board.id not in self._stages:
            track, snapshot = self._tracks.setdefault(board.id, Track()), board.snapshot()
            if snapshot is not None:
                track.take(snapshot)  # so that who looks sees the vehicle at once
            stage = Stage(board, track, self._vehicle_of(board.id), self._scene_of)
            self._stages[board.id] = (stage, self._spawn(stage.run()))
        stage = self._stages[board.id][0]
        stage.viewers.add(viewer)
        viewer.draw_as(stage.kind)

    def _unseat(self, viewer: Viewer) -> None:
        for board_id, (stage, task) in list(self._stages.items()):
            stage.viewers.discard(viewer)
            if not stage.viewers:
                task.cancel()
                del self._stages[board_id]

    def _stage_of(self, viewer: Viewer) -> Stage | None:
        return next((stage for stage, _ in self._stages.values() if viewer in stage.viewers), None)

    def _board(self, board_id: str) -> BoardFeed | None:
        boards = self._boards()
        return next((board for board in boards if board_id in {board.id, ""}), None)

    async def _sample_forever(self) -> None:
        """Keep every board's path, watched or not: a late viewer sees where it has been."""
        count = 0
        while True:
            self._sample(everyone=count % SAMPLES_UNWATCHED == 0)
            count += 1
            await asyncio.sleep(SAMPLE_S)

    def _sample(self, *, everyone: bool) -> None:
        boards = {board.id: board for board in self._boards()}
        for gone in self._tracks.keys() - boards.keys():
            del self._tracks[gone]
        for board_id, board in boards.items():
            snapshot = board.snapshot() if everyone or board_id in self._stages else None
            if snapshot is not None:
                self._tracks.setdefault(board_id, Track()).take(snapshot)
        self._reseat(boards)

    def _reseat(self, boards: dict[str, BoardFeed]) -> None:
        for stage, _ in list(self._stages.values()):
            if boards.get(stage.board.id) is not stage.board:
                for viewer in list(stage.viewers):
                    self._unseat(viewer)
                    viewer.forget_board()
        for viewer in list(self._expected.values()):
            if self._stage_of(viewer) is None:
                self._seat(viewer)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._finish)
        return task

    def _finish(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            log.error("the 3D view stopped", exc_info=task.exception())


def _build_server() -> viser.ViserServer:
    import viser
    from viser import _messages

    with _quiet():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    handlers: Any = server._websock_server
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        handlers.unregister_handler(message)  # it would open a public tunnel for whoever asks
    return server


def _stop_server(server: viser.ViserServer) -> None:
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep viser's banner off the terminal: it goes through rich's global console whatever `verbose` says."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _admit_connection(client: viser.ClientHandle) -> int:
    """Bound what the kernel holds for this client; return the port at the proxy's end, which ties it to a browser."""
    server: Any = client._viser_server
    connection = server._websock_server._live_connections[client.client_id]
    raw: socket.socket = connection.transport.get_extra_info("socket")
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, HOP_BUFFER_BYTES)
    return int(connection.remote_address[1])
