"""A board without a board: engine results and snapshots along a known path, and a server for them."""

from __future__ import annotations

import asyncio
import math
import socket
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import uvicorn
import zstandard
from fastapi import FastAPI
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from server.calibration.scene import CalibrationScene
from server.hub import Hub
from server.nav.lanes.base import Provides
from server.nav.rotation import quat_from_euler
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    ROW_WIDTH,
    STEP_COLUMNS,
    Aid,
    AidHealth,
    AidRows,
    AidStatus,
    FilteredRows,
    Float,
    Kind,
    LaneRows,
    LaneState,
    SampleBlock,
    Snapshot,
    StepResult,
    VehicleClass,
)
from server.view3d import View3D, router

STEP_NS = 20_000_000
RADIUS_M = 30.0
PERIOD_S = 30.0


def lane_row(
    euler_rad: tuple[float, float, float] = (0.0, 0.0, 0.0),
    pos_n_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    vel_n_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    sigma_att_rad: tuple[float, float, float] = (0.006, 0.006, 0.02),
    sigma_pos_n_m: tuple[float, float, float] = (0.1, 0.1, 0.15),
) -> Float:
    """One row of LANE_COLUMNS; what is not given is NaN."""
    row = np.full(len(LANE_COLUMNS), np.nan)
    at = LANE_COLUMNS.index
    row[0:4] = quat_from_euler(*euler_rad)
    row[at("vel_n_m_s") : at("vel_n_m_s") + 3] = vel_n_m_s
    row[at("sigma_att_x_rad") : at("sigma_att_x_rad") + 3] = sigma_att_rad
    row[at("sigma_pos_n_m") : at("sigma_pos_n_m") + 3] = sigma_pos_n_m
    row[at("status")] = 2
    row[at("pos_n_m") : at("pos_n_m") + 3] = pos_n_m
    return row


def circling(t_s: float, offset_m: float = 0.0) -> Float:
    """A climbing circle, banked into the turn, speeding up and slowing down."""
    angle = 2 * math.pi * t_s / PERIOD_S + 0.6 * math.sin(2 * math.pi * t_s / PERIOD_S)
    rate = 2 * math.pi / PERIOD_S * (1 + 0.6 * math.cos(2 * math.pi * t_s / PERIOD_S))
    radius_m = RADIUS_M + offset_m
    pos = (radius_m * math.sin(angle), radius_m * (1 - math.cos(angle)), -8.0 - 4.0 * math.sin(angle / 2))
    vel = (radius_m * rate * math.cos(angle), radius_m * rate * math.sin(angle), 0.0)
    return lane_row((0.35, -0.08, angle), pos, vel)


def turning(t_s: float) -> Float:
    """The attitude of `circling` and nothing else."""
    row = circling(t_s)
    row[LANE_COLUMNS.index("vel_n_m_s") :] = math.nan
    return row


def step_result(rows: dict[str, Float], t_ns: int = 0, block: SampleBlock | None = None) -> StepResult:
    """What the engine would publish for one step."""
    t = np.array([t_ns], dtype=np.int64)
    empty = np.empty(0, dtype=np.int64)
    return StepResult(
        boot_id=0,
        block=block or sample_block([]),
        lanes=tuple(LaneRows(lane=lane, t_ns=t, data=row[None, :]) for lane, row in rows.items()),
        aids=AidRows(t_ns=empty, data=np.empty((0, len(AID_COLUMNS)))),
        filtered=FilteredRows(t_ns=empty, data=np.empty((0, len(STEP_COLUMNS)))),
        events=(),
    )


def sample_block(samples: list[tuple[Kind, tuple[float, ...]]]) -> SampleBlock:
    """A block with these samples."""
    data = np.full((len(samples), ROW_WIDTH), np.nan)
    for row, (_, values) in zip(data, samples, strict=True):
        row[: len(values)] = values
    t = np.zeros(len(samples), dtype=np.int64)
    return SampleBlock(kind=np.array([k for k, _ in samples], dtype=np.uint8), t_ns=t, t_rx_ns=t, data=data)


def provided(row: Float) -> Provides:
    """What the row tells."""
    return "attitude" if math.isnan(row[LANE_COLUMNS.index("pos_n_m")]) else "full"


def snapshot_of(
    rows: dict[str, Float], t_ns: int = 0, fix: tuple[float, float, float] | None = None, boot_id: int = 0
) -> Snapshot:
    """A snapshot with these lanes (of those without a position the attitude alone), and a fused fix at this place."""
    aids: tuple[AidHealth, ...] = ()
    if fix is not None:
        last = [math.nan] * len(AID_COLUMNS)
        last[0], last[1], last[2:5], last[-1] = Aid.GNSS_POSITION, AidStatus.FUSED, fix, t_ns
        aids = (AidHealth(aid=Aid.GNSS_POSITION, fused=1, refused=(), t_fused_ns=t_ns, last=tuple(last)),)
    return Snapshot(
        boot_id=boot_id,
        t_ns=t_ns,
        lanes=tuple(LaneState(lane=lane, provides=provided(row), t_ns=t_ns, row=row) for lane, row in rows.items()),
        sensors=(),
        aids=aids,
        site=None,
        filtered=(),
        events=(),
        steps=0,
    )


@dataclass(eq=False)
class SyntheticBoard:
    """Flies `circling` on demand; `fly` publishes a step, `snapshot` tells the newest."""

    id: str = "one"
    hub: Hub = field(default_factory=Hub)
    t_ns: int = 0
    rows: dict[str, Float] = field(default_factory=dict)
    fix: tuple[float, float, float] | None = None
    block: SampleBlock | None = None
    snapshots: int = 0
    more: tuple[str, ...] = ()
    """Lanes beside the three that tell the attitude alone."""
    off: frozenset[str] = frozenset()
    main_lane: str = "ins_ekf"
    mag_scale: float = 1.0

    def snapshot(self) -> Snapshot | None:
        self.snapshots += 1
        return snapshot_of(self.rows, self.t_ns, self.fix) if self.rows else None

    def fly(self, publish: bool = True) -> None:
        """Advance one navigation step of 20 ms."""
        self.t_ns += STEP_NS
        t_s = self.t_ns / 1e9
        everything = {"ins_ekf": circling(t_s), "reference": circling(t_s, 0.5), "onboard": circling(t_s, -0.8)}
        self.rows = {lane: everything.get(lane, turning(t_s)) for lane in (*everything, *self.more)}
        self.rows = {lane: row for lane, row in self.rows.items() if lane not in self.off}
        at = LANE_COLUMNS.index("pos_n_m")
        if self.t_ns % (10 * STEP_NS) == 0:
            noise = np.random.default_rng(self.t_ns).normal(0, 0.3, 3)
            self.fix = tuple((circling(t_s)[at : at + 3] + noise).tolist())
        if publish:
            gnss = (math.nan,) * 6 + (0.8, 1.2, 0.1, 3.0, 14.0)
            block = sample_block([(Kind.GNSS, gnss)]) if self.t_ns % (10 * STEP_NS) == 0 else self.block
            self.hub.results.publish(step_result(self.rows, self.t_ns, block))

    async def fly_forever(self) -> None:
        """Fly at 50 Hz."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            self.fly()
            due += STEP_NS / 1e9
            await asyncio.sleep(max(due - loop.time(), 0.0))


@dataclass
class Served:
    """A view3d app on a real port in a thread of its own."""

    port: int
    view: View3D
    boards: list[SyntheticBoard]
    loop: asyncio.AbstractEventLoop


@contextmanager
def served(
    boards: list[SyntheticBoard],
    kind: VehicleClass = VehicleClass.MULTIROTOR,
    fly: bool = True,
    scene_of: Callable[[str], CalibrationScene | None] | None = None,
) -> Iterator[Served]:
    """Serve boards until the block ends."""
    view = View3D(lambda: boards, lambda _board_id: kind, scene_of)
    app = FastAPI()
    app.include_router(router(view))
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 131072)  # as the service does
    listener.bind(("127.0.0.1", 0))
    config = uvicorn.Config(app, log_level="warning", ws_per_message_deflate=False, lifespan="off")
    server = uvicorn.Server(config)
    loops: list[asyncio.AbstractEventLoop] = []

    async def main() -> None:
        loops.append(asyncio.get_running_loop())
        await view.start()
        flying = [asyncio.create_task(board.fly_forever()) for board in boards if fly]
        await server.serve(sockets=[listener])
        for task in flying:
            task.cancel()
        await view.stop()

    thread = threading.Thread(target=lambda: asyncio.run(main()), daemon=True)
    thread.start()
    while not server.started and thread.is_alive():
        thread.join(0.02)
    try:
        yield Served(port=listener.getsockname()[1], view=view, boards=boards, loop=loops[0])
    finally:
        server.should_exit = True
        thread.join(10)


def camera_message(**changes: object) -> dict[str, object]:
    """What viser's client reports of its camera."""
    return {
        "type": "ViewerCameraMessage",
        "wxyz": [1.0, 0.0, 0.0, 0.0],
        "position": [-2, 0, 1],
        "fov": 1,
        "near": 0.1,
        "far": 100,
        "image_height": 300,
        "image_width": 400,
        "look_at": [0, 0, 0],
        "up_direction": [0, 0, 1],
        **changes,
    }


class Watcher:
    """A browser without a picture: speaks viser's wire format through our proxy and keeps what it was sent."""

    def __init__(self, connection: ClientConnection) -> None:
        self._socket = connection
        self.messages: list[dict[str, Any]] = []

    @classmethod
    @asynccontextmanager
    async def connected(cls, port: int, query: str = "", origin: str | None = None) -> AsyncIterator[Watcher]:
        """Connect, report a camera, and read in the background until the block ends."""
        url = f"ws://127.0.0.1:{port}/view?{query}"
        raw = socket.socket()
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
        raw.connect(("127.0.0.1", port))
        raw.setblocking(False)
        options: dict[str, Any] = {
            "origin": origin,
            "compression": None,
            "max_size": None,
            "sock": raw,
            "close_timeout": 1,
        }
        async with connect(url, subprotocols=[Subprotocol("viser-v1.1.1")], **options) as connection:
            watcher = cls(connection)
            await watcher.send(camera_message())
            reading = asyncio.create_task(watcher._read())
            try:
                yield watcher
            finally:
                reading.cancel()

    async def send(self, message: object) -> None:
        """Send as viser's client would."""
        await self._socket.send(msgspec.msgpack.encode(message))

    async def command(self, **fields: object) -> None:
        """Send what our injected script would."""
        await self.send({"type": "NavdeckViewCommand", **fields})

    async def until(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first message, past or future, that is wanted."""
        async with asyncio.timeout(15):
            seen = 0
            while True:
                for message in self.messages[seen:]:
                    seen += 1
                    if wanted(message):
                        return message
                await asyncio.sleep(0.01)  # another thread makes it true

    async def node(self, name: str) -> dict[str, Any]:
        """Return the message that made this node."""
        return await self.until(lambda message: message.get("name") == name and "props" in message)

    def named(self, prefix: str) -> set[str]:
        """Names of all nodes that were made under a prefix."""
        return {m["name"] for m in self.messages if "props" in m and str(m.get("name")).startswith(prefix)}

    async def _read(self) -> None:
        async for window in self._socket:
            assert isinstance(window, bytes)
            size = int.from_bytes(window[8:16], "little")
            inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(window[16 : 16 + size]))
            arrays = _arrays(window, 16 + size, inner["binaryBufferLengths"])
            for message in inner["messages"]:
                for part in ("props", "updates"):
                    message.update({part: _filled(message[part], arrays)} if part in message else {})
                self.messages.append(message)


def _arrays(window: bytes, start: int, lengths: list[int]) -> list[bytes]:
    """The raw arrays behind the messages of a window, each on a multiple of eight bytes."""
    found = []
    for length in lengths:
        start += -start % 8
        found.append(window[start : start + length])
        start += length
    return found


def _filled(fields: dict[str, Any], arrays: list[bytes]) -> dict[str, Any]:
    """The fields with flat arrays in the places that stand for them."""
    return {
        name: np.frombuffer(arrays[value["__binary_index"]], dtype=np.dtype(value["dtype"]))
        if isinstance(value, dict) and "__binary_index" in value
        else value
        for name, value in fields.items()
    }


async def eventually(true: Callable[[], bool]) -> None:
    """Return as soon as it is true; fail after 15 s."""
    async with asyncio.timeout(15):
        while not true():  # noqa: ASYNC110  # another thread makes it true
            await asyncio.sleep(0.01)  # another thread makes it true
