"""A link, a protocol and an engine small enough to predict every row, and a service that runs on them.

The protocol takes every byte as one IMU sample, 2 ms after the one before; byte 0xFF is a reboot, 0xEE a text, and 0xDD
breaks the engine. The engine gives one row of each of its estimators that is chosen (`ins_ekf` and `steady`) for every
tenth sample, whose columns count up from its number.
"""

import asyncio
import contextlib
import math
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import httpx
import numpy as np
from websockets.asyncio.client import ClientConnection, connect

from server.app import Service
from server.board import BoardParts
from server.commands import AddBoard
from server.link.base import Chunk, LinkState, LinkStatus
from server.listener import listening_socket
from server.nav.calibration.applied import Calibration
from server.nav.lanes.base import Parameter
from server.nav.lanes.registry import LaneInfo
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    ROW_WIDTH,
    STEP_COLUMNS,
    Aid,
    AidHealth,
    AidRows,
    AidStatus,
    Event,
    FilteredRows,
    Kind,
    LaneRows,
    LaneState,
    LaneStatus,
    SampleBlock,
    SensorHealth,
    Snapshot,
    StepResult,
)
from server.protocol.base import Decoded, ProtocolStats, SenderStats
from server.settings import LoadedSettings, load_settings

SAMPLE_NS = 2_000_000
SAMPLES_PER_STEP = 10
REBOOT, TEXT, BREAK = 0xFF, 0xEE, 0xDD
STATUS_AT = LANE_COLUMNS.index("status")
PARAMETERS = (
    Parameter(name="gain_hz", unit="Hz", default=0.5, minimum=0.1, maximum=2.0, meaning="More follows faster."),
    Parameter(name="window_s", unit="s", default=math.nan, minimum=1.0, maximum=10.0, meaning="More is smoother."),
)
LANES = {"ins_ekf": (), "steady": PARAMETERS, "onboard": (), "reference": ()}
PROVIDES = {"steady": "attitude"}
ESTIMATING = ("ins_ekf", "steady")


class FakeLink:
    """Bytes that the test pushes."""

    def __init__(self, url: str) -> None:
        self.status = LinkStatus(url=url, state=LinkState.OPENING, code="opening", since_ns=time.monotonic_ns())
        self.written = b""
        self.closed = False
        self._queue: asyncio.Queue[bytes | None] = asyncio.Queue()

    def push(self, data: bytes) -> None:
        self._queue.put_nowait(data)

    def end(self) -> None:
        self._queue.put_nowait(None)

    def tell(self, state: LinkState, **more: Any) -> None:
        self.status = replace(self.status, state=state, since_ns=time.monotonic_ns(), **more)

    async def chunks(self) -> AsyncIterator[Chunk]:
        self.tell(LinkState.OPEN, code="")
        new_session = True
        while (data := await self._queue.get()) is not None:
            now_ns = time.monotonic_ns()
            self.status = replace(self.status, bytes_in=self.status.bytes_in + len(data), t_last_rx_ns=now_ns)
            yield Chunk(data, now_ns, new_session)
            new_session = False
        self.tell(LinkState.ENDED)

    def write(self, data: bytes) -> None:
        self.written += data

    async def close(self) -> None:
        self.closed = True
        self.end()


class FakeProtocol:
    def __init__(self, command: AddBoard) -> None:
        self.command = command
        self.t_ns = 0
        self.connections = 0
        self.stats = ProtocolStats(protocol="fake", senders=(SenderStats(system=1, component=1, frames=0, lost=0),))

    def connected(self, now_ns: int) -> None:
        self.connections += 1

    def outgoing(self, now_ns: int) -> bytes:
        return b"beat"

    def feed(self, data: bytes, t_rx_ns: int) -> Decoded:
        texts = tuple((6, "hello") for byte in data if byte == TEXT)
        if REBOOT in data:
            self.t_ns = 0
            self.stats = replace(self.stats, boot_id=self.stats.boot_id + 1)
        count = sum(byte not in {REBOOT, TEXT} for byte in data)
        self.stats = replace(
            self.stats,
            bytes_in=self.stats.bytes_in + len(data),
            bytes_frames=self.stats.bytes_frames + len(data),
            frames=self.stats.frames + count,
        )
        if not count:
            return Decoded(texts=texts)
        t_ns = self.t_ns + SAMPLE_NS * np.arange(1, count + 1, dtype=np.int64)
        self.t_ns = int(t_ns[-1])
        rows = np.full((count, ROW_WIDTH), np.nan)
        rows[:, 0] = [byte for byte in data if byte not in {REBOOT, TEXT}]
        kind = np.full(count, Kind.IMU, dtype=np.uint8)
        rx_ns = np.full(count, t_rx_ns, dtype=np.int64)
        return Decoded(
            blocks=(SampleBlock(kind=kind, t_ns=t_ns, t_rx_ns=rx_ns, data=rows, boot_id=self.stats.boot_id),),
            texts=texts,
        )


def lane_row(step: int, status: LaneStatus = LaneStatus.NAVIGATING) -> np.ndarray:
    """The row of one step: a unit quaternion, then step + column/100; the last column is unknown."""
    row = step + np.arange(len(LANE_COLUMNS)) / 100.0
    row[:4] = (1.0, 0.0, 0.0, 0.0)
    row[STATUS_AT], row[-1] = status, np.nan
    return row


class FakeEngine:
    def __init__(self) -> None:
        self.samples = self.steps = 0
        self.t_ns = -1
        self.boot_id = 0
        self.status = LaneStatus.NAVIGATING
        self.chosen: tuple[str, ...] = ("ins_ekf", "onboard", "reference")
        self.values = {lane: {one.name: one.default for one in known} for lane, known in LANES.items()}
        self.failures: dict[str, str] = {}

    def lanes(self) -> tuple[LaneInfo, ...]:
        return tuple(
            LaneInfo(
                name=name,
                provides=PROVIDES.get(name, "full"),
                running=name in self.chosen and name not in self.failures,
                failure=self.failures.get(name, ""),
                parameters=known,
                values=dict(self.values[name]),
            )
            for name, known in LANES.items()
        )

    def choose_lanes(self, names: tuple[str, ...]) -> None:
        if not names or len(set(names)) != len(names) or set(names) - set(LANES):
            raise ValueError(f"lanes {', '.join(names)}: name at least one, each once")
        self.chosen, self.failures = names, {}

    def set_lane_parameters(self, lane: str, values: Mapping[str, float]) -> None:
        self.values[lane] |= values
        self.failures.pop(lane, None)

    def set_calibration(self, calibration: Calibration) -> None:
        self.calibration = calibration

    def converted(self, kind: Kind, rows: np.ndarray) -> np.ndarray:
        return rows

    def chain(self) -> tuple[()]:
        return ()

    def set_chain(self, sensor: str, values: Mapping[str, float]) -> None:
        raise ValueError(f"there is no preprocessing of {sensor}")

    def set_mag_learning(self, run: bool, apply: bool) -> None:
        self.learning = (run, apply)

    def mag_learning(self) -> None:
        return None

    def _estimating(self) -> list[str]:
        return [name for name in ESTIMATING if name in self.chosen and name not in self.failures]

    def step(self, block: SampleBlock) -> StepResult:
        if BREAK in block.data[:, 0]:
            raise RuntimeError("the engine broke")
        if block.boot_id != self.boot_id:
            self.boot_id, self.samples, self.steps = block.boot_id, 0, 0
        before, self.samples = self.steps, self.samples + len(block.t_ns)
        self.steps = self.samples // SAMPLES_PER_STEP
        at = np.arange(before + 1, self.steps + 1)
        t_ns = at.astype(np.int64) * SAMPLES_PER_STEP * SAMPLE_NS
        self.t_ns = int(block.t_ns[-1])
        rows = np.array([lane_row(int(step), self.status) for step in at]).reshape(len(at), len(LANE_COLUMNS))
        return StepResult(
            boot_id=block.boot_id,
            block=block,
            lanes=tuple(LaneRows(lane=name, t_ns=t_ns, data=rows) for name in self._estimating()),
            aids=AidRows(t_ns=t_ns, data=np.repeat(at[:, None], len(AID_COLUMNS), axis=1).astype(float)),
            filtered=FilteredRows(t_ns=t_ns, data=np.zeros((len(at), len(STEP_COLUMNS)))),
            events=(Event(t_ns=0, code="born", severity="info", text="Born."),) if before == 0 < self.steps else (),
        )

    def snapshot(self) -> Snapshot:
        imu = SensorHealth(
            name="imu", t_last_ns=self.t_ns, rate_hz=500.0, samples=self.samples, repeated=0, refused=(("range", 2),)
        )
        refused = ((AidStatus.REFUSED_GATE, 3),)
        last = tuple(map(float, range(len(AID_COLUMNS))))
        aid = AidHealth(aid=Aid.BARO_HEIGHT, fused=self.steps, refused=refused, t_fused_ns=self.t_ns, last=last)
        lanes = tuple(
            LaneState(
                lane=name,
                provides=PROVIDES.get(name, "full"),
                t_ns=self.steps * SAMPLES_PER_STEP * SAMPLE_NS,
                row=lane_row(self.steps, self.status),
            )
            for name in self._estimating()
        )
        return Snapshot(
            boot_id=self.boot_id,
            t_ns=self.t_ns,
            lanes=lanes if self.steps else (),
            sensors=(imu,),
            aids=(aid,),
            site=None,
            filtered=(),
            events=(),
            steps=self.steps,
        )


@dataclass
class FakeFactories:
    """Remembers every part it made, newest last."""

    links: dict[str, list[FakeLink]] = field(default_factory=dict)
    protocols: list[FakeProtocol] = field(default_factory=list)
    engines: list[FakeEngine] = field(default_factory=list)

    def load(self) -> None:
        pass

    def link(self, url: str) -> FakeLink:
        """The newest link of this URL."""
        return self.links[url][-1]

    def parts(self, command: AddBoard, observe_latency: Callable[[float], None]) -> BoardParts:
        def link() -> FakeLink:
            if "bad" in command.url:
                raise ValueError(f"{command.url!r} is not good. Write another.")
            made = FakeLink(command.url)
            self.links.setdefault(command.url, []).append(made)
            return made

        def protocol() -> FakeProtocol:
            self.protocols.append(FakeProtocol(command))
            return self.protocols[-1]

        def engine() -> FakeEngine:
            self.engines.append(FakeEngine())
            return self.engines[-1]

        return BoardParts(link=link, protocol=protocol, engine=engine, observe_latency=observe_latency)


def fake_settings(**flags: Any) -> LoadedSettings:
    """Settings of a test: one demo board, no 3D view, nothing of the environment."""
    return load_settings({"links": ("sim:",), "view3d": False, "data_dir": EMPTY.name, **flags})


EMPTY = tempfile.TemporaryDirectory(prefix="navdeck-test-")
"""Data folder of services whose test does not name one: nobody's calibrations are read or written."""


@dataclass
class Running:
    """A service that listens, and how to talk to it."""

    service: Service
    factories: Any
    url: str
    client: httpx.AsyncClient

    @property
    def socket_url(self) -> str:
        return self.url.replace("http:", "ws:") + "/api/v1/stream"

    def stream(self, **more: Any) -> connect:
        return connect(self.socket_url, compression=None, **more)

    def push(self, count: int, url: str = "sim:") -> None:
        """Have samples arrive."""
        self.factories.link(url).push(bytes(count))


@contextlib.asynccontextmanager
async def running(loaded: LoadedSettings | None = None, factories: Any = None) -> AsyncIterator[Running]:
    """Run a service on a free port of this machine, in the test's own loop."""
    factories = factories or FakeFactories()
    service = Service(loaded or fake_settings(), factories)
    await service.add_links()
    started: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(service.run(listening_socket("127.0.0.1", 0), started.set_result))
    both: set[asyncio.Future[Any]] = {task, started}
    done, _ = await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
    if task in done:
        task.result()
    try:
        async with httpx.AsyncClient(base_url=started.result(), timeout=10.0) as client:
            yield Running(service, factories, started.result(), client)
    finally:
        service.stop()
        await task


async def until(truth: Callable[[], object], within_s: float = 5.0) -> None:
    """Wait until something holds; the test fails when it does not within the time."""
    async with asyncio.timeout(within_s):
        while not truth():  # noqa: ASYNC110  # what is waited for has no event
            await asyncio.sleep(0.005)


async def next_binary(socket: ClientConnection) -> bytes:
    """The next binary message; texts before it are passed over."""
    while True:
        message = await asyncio.wait_for(socket.recv(), 5.0)
        if isinstance(message, bytes):
            return message
