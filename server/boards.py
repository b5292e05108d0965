"""The set of boards: carries out commands on them, and keeps each one's task."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Final, TypeVar
from urllib.parse import unquote

from server.board import Board, BoardParts
from server.commands import (
    AddBoard,
    ChooseLanes,
    Done,
    ReconnectBoard,
    Refusal,
    RefusalKind,
    RemoveBoard,
    SetLaneParameters,
)
from server.lane_commands import choose_lanes, set_lane_parameters

MAX_BOARDS: Final = 16
SCHEMES: Final = ("serial", "tcp", "tcp-listen", "udp", "file", "sim", "auto")
MakeParts = Callable[[AddBoard, str], BoardParts]
_LaneCommand = TypeVar("_LaneCommand", ChooseLanes, SetLaneParameters)


class Boards:
    """Every board of this process, in the order in which they were added."""

    def __init__(self, make_parts: MakeParts, lanes: tuple[str, ...], history_s: float, data_dir: Path) -> None:
        self._make_parts = make_parts
        self._lanes = lanes
        self._history_s = history_s
        self._data_dir = data_dir
        self._boards: dict[str, Board] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._keys: dict[str, str] = {}
        self._group: asyncio.TaskGroup | None = None
        self.on_added: list[Callable[[Board], Awaitable[None]]] = []
        self.on_removed: list[Callable[[str], None]] = []
        self.on_lanes: list[Callable[[Board], None]] = []

    def __iter__(self) -> Iterator[Board]:
        return iter(tuple(self._boards.values()))

    def get(self, board_id: str) -> Board | None:
        """Return the board of this id; None when there is none."""
        return self._boards.get(board_id)

    def start(self, group: asyncio.TaskGroup) -> None:
        """Run every board, and those added later, in this task group."""
        self._group = group
        for board in self:
            self._run(board)

    def stop(self) -> None:
        """Cancel every board's task; the task group waits for them."""
        for task in self._tasks.values():
            task.cancel()

    async def add(self, command: AddBoard) -> Done | Refusal:
        """Open a link and run a board on it."""
        refusal = self._refused(command)
        if refusal is not None:
            return refusal
        board_id = self._new_id(command.url)
        try:
            board = Board(board_id, command.url, self._lanes, self._make_parts(command, board_id), self._history_s)
        except ValueError as error:
            what, _, remedy = str(error).removeprefix(repr(command.url)).partition(". ")
            return _bad_url(command.url, f"{command.url[:80]!r}{what}.", remedy)
        self._boards[board_id] = board
        self._keys[board_id] = link_key(command.url)
        for told in self.on_added:
            await told(board)
        if self._group is not None and self._boards.get(board_id) is board:  # it may have been removed meanwhile
            self._run(board)
        return Done(board_id=board_id)

    async def remove(self, command: RemoveBoard) -> Done | Refusal:
        """Close the link and forget the board."""
        if command.board_id not in self._boards:
            return no_board(command.board_id)
        del self._boards[command.board_id], self._keys[command.board_id]
        task = self._tasks.pop(command.board_id, None)
        if task is not None:
            task.cancel()
            await asyncio.wait({task}, timeout=5.0)
        for told in self.on_removed:
            told(command.board_id)
        return Done(board_id=command.board_id)

    async def reconnect(self, command: ReconnectBoard) -> Done | Refusal:
        """Close the link and open it anew."""
        board = self._boards.get(command.board_id)
        if board is None:
            return no_board(command.board_id)
        await board.reconnect()
        return Done(board_id=board.id)

    async def choose_lanes(self, command: ChooseLanes) -> Done | Refusal:
        """Run these lanes of a board and no others."""
        return self._change_lanes(command, choose_lanes)

    async def set_lane_parameters(self, command: SetLaneParameters) -> Done | Refusal:
        """Change numbers of one lane of a board."""
        return self._change_lanes(command, set_lane_parameters)

    def _change_lanes(
        self, command: _LaneCommand, carry_out: Callable[[Board, _LaneCommand], Done | Refusal]
    ) -> Done | Refusal:
        board = self._boards.get(command.board_id)
        if board is None:
            return no_board(command.board_id)
        reply = carry_out(board, command)
        for told in self.on_lanes if isinstance(reply, Done) else ():
            told(board)
        return reply

    def _run(self, board: Board) -> None:
        if self._group is not None:
            self._tasks[board.id] = self._group.create_task(board.run(), name=f"board {board.id}")

    def _refused(self, command: AddBoard) -> Refusal | None:
        if not command.trusted:
            refusal = _untrusted(command.url, self._data_dir)
            if refusal is not None:
                return refusal
        key = link_key(command.url)
        holder = next((board_id for board_id, known in self._keys.items() if known == key), None)
        if holder is not None:
            return Refusal(
                kind=RefusalKind.CONFLICT,
                code="link-in-use",
                detail=f"Board {holder} already uses this link.",
                remedy=f"Use that board, or remove it first: DELETE /api/v1/boards/{holder}.",
                name="url",
                value=command.url,
            )
        if len(self._boards) >= MAX_BOARDS:
            return Refusal(
                kind=RefusalKind.CONFLICT,
                code="too-many-boards",
                detail=f"There are {len(self._boards)} boards; at most {MAX_BOARDS} are allowed.",
                remedy="Remove a board that is not needed.",
            )
        return None

    def _new_id(self, url: str) -> str:
        stem = id_from_url(url)
        names = (stem if n == 1 else f"{stem}-{n}" for n in range(1, MAX_BOARDS + 2))
        return next(name for name in names if name not in self._boards)


def split_link(url: str) -> tuple[str, str]:
    """Return kind and place of a link's URL just as `server.link.url` reads them; a bare path is a serial port."""
    text = url.strip()
    if text.startswith("/"):
        return "serial", unquote(text.partition("?")[0])
    scheme = re.split("[:?]", text, maxsplit=1)[0].lower()
    rest = text[len(scheme) :].partition("?")[0].removeprefix(":")
    return scheme, unquote(rest.removeprefix("//"))


def id_from_url(url: str) -> str:
    """Return a short, stable name for the board on this link, fit for a path: the port, file or address."""
    scheme, place = split_link(url)
    names = {"serial": Path(place).name, "file": Path(place).stem}
    text = names.get(scheme, f"{scheme}-{place}")
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:40].strip("-") or "board"


def link_key(url: str) -> str:
    """Return what two links have in common when both would take the same port or address."""
    scheme, place = split_link(url)
    if scheme in {"sim", "file"}:
        return url.strip()
    return f"serial:{Path(place).resolve()}" if scheme == "serial" else f"{scheme}:{place.lower().rstrip('/')}"


def no_board(board_id: str) -> Refusal:
    """Say that there is no such board."""
    return Refusal(
        kind=RefusalKind.MISSING,
        code="no-such-board",
        detail=f"There is no board {board_id[:80]!r}.",
        remedy="GET /api/v1/boards lists them.",
        name="board_id",
        value=board_id[:80],
    )


def _bad_url(url: str, detail: str, remedy: str = "") -> Refusal:
    return Refusal(
        kind=RefusalKind.INVALID,
        code="bad-link",
        detail=detail,
        remedy=remedy
        or f"Use one of {', '.join(scheme + ':' for scheme in SCHEMES)}, as in serial:///dev/ttyACM0?baud=921600.",
        name="url",
        value=url,
    )


def _untrusted(url: str, data_dir: Path) -> Refusal | None:
    """Refuse from the network what would touch files of this machine; a file's absence looks like its presence."""
    if any(ord(letter) < 32 for letter in unquote(url)):
        return _bad_url(url, "A link holds no control characters.")
    scheme, place = split_link(url)
    if scheme not in SCHEMES:
        return _bad_url(url, f"{url[:80]!r} is not a link that may be opened from here.")
    plain = url.strip().lower().startswith((f"{scheme}:///", "/"))  # so that what is judged is what is opened
    if scheme == "serial" and not plain:
        return _bad_url(url, "From here only serial:///dev/… is understood.")
    if scheme == "serial" and not Path(place).resolve().is_relative_to("/dev"):
        return _bad_url(url, f"{place!r} is not below /dev, where serial ports are.")
    if scheme == "file" and not (plain and Path(place).expanduser().resolve().is_relative_to(data_dir.resolve())):
        return Refusal(
            kind=RefusalKind.INVALID,
            code="file-not-allowed",
            detail=f"Only files in the data folder {data_dir} may be opened through the API.",
            remedy="Put the log there, or name it on the command line: navdeck --link file:///path/to/log.tlog.",
            name="url",
            value=url,
        )
    return None
