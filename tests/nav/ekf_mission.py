"""The recorded autopilot flight as one block of samples, ways to spoil it, and its truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from server.magnetic import wmm_field
from server.nav.types import Kind, SampleBlock
from server.replay.tlog import TlogLog

from .ekf_flights import Floats
from .ekf_flown import Flown, fly

IMU_DELAY_S, MAG_DELAY_S, GNSS_DELAY_S = 0.011, 0.050, 0.098  # measured (data INDEX); what the profile row says
METRES_PER_DEG = 111_170.0


def mission(shared_data: Path, name: str = "mission") -> SampleBlock:
    """Return every sample of the flight."""
    (block,) = TlogLog(shared_data / "ardupilot_sitl" / f"{name}.tlog").blocks(10**9)
    return block


def only(block: SampleBlock, keep: NDArray[np.bool_]) -> SampleBlock:
    """Return the chosen rows."""
    return SampleBlock(
        kind=np.ascontiguousarray(block.kind[keep]),
        t_ns=np.ascontiguousarray(block.t_ns[keep]),
        t_rx_ns=np.ascontiguousarray(block.t_rx_ns[keep]),
        data=np.ascontiguousarray(block.data[keep]),
        boot_id=block.boot_id,
    )


def without(block: SampleBlock, kind: Kind) -> SampleBlock:
    """Return the block without one kind of rows."""
    return only(block, block.kind != kind)


def changed(
    block: SampleBlock, kind: Kind, change: Callable[[Floats], None], start_s: float = -np.inf, end_s: float = np.inf
) -> SampleBlock:
    """Return the block with the rows of one kind and of [start, end) changed: change(rows) in place."""
    t_s = block.t_ns * 1e-9
    chosen = (block.kind == kind) & (t_s >= start_s) & (t_s < end_s)
    data = block.data.copy()
    rows = data[chosen]
    change(rows)
    data[chosen] = rows
    return SampleBlock(kind=block.kind, t_ns=block.t_ns, t_rx_ns=block.t_rx_ns, data=data, boot_id=block.boot_id)


def fly_mission(block: SampleBlock, **settings: object) -> Flown:
    """Run the main lane over the flight, with the Earth's field."""
    return fly(block, wmm_field, **settings)


def truth(block: SampleBlock) -> tuple[Slerp, Floats, Floats]:
    """Return the true attitude as a function of seconds, and stamps and (N, 3) velocities."""
    rows = block.kind == Kind.REFERENCE
    t_s, data = block.t_ns[rows] * 1e-9, block.data[rows]
    known = np.isfinite(data[:, 0])
    attitude = Slerp(t_s[known], Rotation.from_quat(data[known, :4], scalar_first=True))
    moving = np.isfinite(data[:, 7])
    return attitude, t_s[moving], data[moving, 7:10]


def heading_error_deg(flown: Flown, block: SampleBlock) -> tuple[Floats, Floats]:
    """Return stamps and heading errors against the truth, degrees."""
    attitude, _, _ = truth(block)
    t_s = flown.t_s
    known = np.isfinite(flown.rows[:, 0]) & (t_s >= attitude.times[0]) & (t_s <= attitude.times[-1])
    estimate = Rotation.from_quat(flown.rows[known, :4], scalar_first=True)
    return t_s[known], (estimate * attitude(t_s[known]).inv()).as_rotvec(degrees=True)[:, 2]


def apart_m(flown: Flown, other: Flown) -> Floats:
    """Return the distance between the positions of two runs, row by row, m."""
    scale = np.array([METRES_PER_DEG, METRES_PER_DEG * np.cos(np.radians(47.4)), 1.0])
    return np.linalg.norm((flown.rows[:, 7:10] - other.rows[:, 7:10]) * scale, axis=1)
