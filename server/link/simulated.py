"""`sim:`: the demo board on a real pseudo-terminal, read by the very same serial reader."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from server.link.causes import Trouble
from server.link.find import Finder
from server.link.pipe import PipeConnection
from server.link.retry import RetryLink
from server.link.serial_link import connect_tty

if TYPE_CHECKING:
    from server.simulator import Command, SimulatorState

_BAUD = 921_600


class Board(Protocol):
    """What this link needs of the demo board."""

    def start(self) -> str:
        """Return the path of the pseudo-terminal the board speaks on."""
        ...

    def stop(self) -> None:
        """End the board; a second call does nothing."""
        ...

    def ask(self, command: Command | None = None) -> Future[SimulatorState]:
        """Have it carry a command out, or None; the answer is its state then."""
        ...


class SimLink(RetryLink):
    """Starts a board, reads it, and starts another one should it end."""

    def __init__(self, url: str, finder: Finder) -> None:
        super().__init__(url)
        self._finder = finder
        self._board: Board | None = None
        self._device = ""

    async def control(self, command: Command | None = None) -> SimulatorState:
        """Turn the board, or what is around it; return its state then. None only asks for the state.

        Raises:
            ValueError: this board cannot do it; the text says why and what to do.
            ConnectionError: the board does not run (now): it is starting, or the link was closed.
        """
        board = self._board
        if board is None:
            raise ConnectionError("the demo board does not run")
        return await asyncio.wrap_future(board.ask(command))

    def _open_details(self) -> dict[str, str]:
        return {"device": self._device, "baud": str(_BAUD)}

    async def _connect(self) -> PipeConnection:
        await self._release()
        board = await asyncio.to_thread(demo_board, self._url)
        starting = asyncio.get_running_loop().run_in_executor(None, board.start)
        try:
            self._device = await asyncio.shield(starting)
        except asyncio.CancelledError:
            starting.add_done_callback(lambda _: board.stop())
            raise
        except OSError as error:
            raise Trouble("sim-failed", error=error.strerror or str(error)) from error
        self._board = board
        return await connect_tty(Path(self._device), _BAUD, self._finder)

    async def _release(self) -> None:
        board, self._board = self._board, None
        if board is not None:
            await asyncio.to_thread(board.stop)


def demo_board(url: str) -> Board:
    """Return the demo board a `sim:` link asks for, not started; imported here because it is heavy."""
    from server.sim import SimBoard
    from server.sim.settings import sim_settings

    return SimBoard(sim_settings(url))
