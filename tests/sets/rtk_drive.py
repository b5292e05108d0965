"""A car with a 100 Hz inertial sensor and an RTK receiver on its roof, 4 km in 549 s.

**Clock.** A logger stamped what it received; the .tag files hold its ticks (and count the CR that the recording has
lost). A sample's time is the sensor's own millisecond counter, its rate against the ticks taken from the earliest
arrivals (+13 ppm). The first whole line is put at the start of the file, 19:34:21.854 GPST, and the published offset of
-0.125 s is added. `t_ns` is GPST since 19:34:00. The published converter instead stretches the counter until its end
meets the last tick, which makes the end of the drive 0.14 s late: `clock="published"` does the same.

**Receiver.** The positions are of their stamps, to within 10 ms of the accelerometer so stamped. The velocities are
not: each is the mean over the navigation interval that ends at its stamp, so 0.125 s old. gnss.csv keeps them in the
row they came in, as a receiver would send them; `velocity_age_s=0.125` writes them as rows of their own at the time
they are valid. reference.csv always has them there. Both hold the antenna's position, 5 cm left of the sensor.

**Mounting.** v_b = R(rpy)ᵀ v_s. Driving straight, what is left is 0.02° in yaw and in pitch. Heights are above the sea.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from tests.sets import folder
from tests.sets.folder import Floats, Ints

DATE = "2025-07-08"
DAY_START_S = 19 * 3600 + 34 * 60.0
"""t_ns = 0, seconds of the GPST day."""
IMU_OFFSET_S = -0.125
VELOCITY_AGE_S = 0.125
MOUNTING_RPY_DEG = (180.0, -6.79, 185.35)
LEVER_ARM_B_M = [0.0, -0.05, 0.0]
G_M_S2 = 9.80665
TAG_HEADER = struct.Struct("<60xIId")
FIX_TYPE_OF_QUALITY = {1: 6.0, 2: 5.0, 4: 4.0}
ENVELOPE_S = 10.0

Clock = Literal["tags", "published"]


def load_imu(shared_data: Path) -> tuple[Floats, Ints]:
    """Return the whole lines, shape (N, 7), and where each ended in the file as it was logged, with CR."""
    raw = (shared_data / "rtkx_drive" / "imu_1934.csv").read_bytes()
    ends = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n")) + 1
    ends_logged = ends + np.arange(1, len(ends) + 1)
    rows = np.loadtxt(raw.decode("ascii").splitlines()[1 : len(ends) - 1], delimiter=",")
    return rows, ends_logged[1 : len(ends) - 1].astype(np.int64)


def load_tags(shared_data: Path) -> tuple[float, Ints]:
    """Return the file's start in seconds of the GPST day, and rows of (tick ms, bytes logged)."""
    raw = (shared_data / "rtkx_drive" / "imu_1934.csv.tag").read_bytes()
    _, seconds, fraction = TAG_HEADER.unpack_from(raw)
    return seconds % 86400 + fraction, np.frombuffer(raw[TAG_HEADER.size :], "<u4").reshape(-1, 2).astype(np.int64)


def counter_rate(counter_ms: Floats, ends: Ints, tags: Ints) -> float:
    """Return logger seconds per counter second: a line through the earliest arrival of every ten seconds."""
    last = np.searchsorted(ends, tags[:, 1], side="right") - 1
    tick_ms, sent_ms = tags[last >= 0, 0].astype(np.float64), counter_ms[last[last >= 0]]
    late_ms, bins = tick_ms - sent_ms, (sent_ms // (1000.0 * ENVELOPE_S)).astype(int)
    earliest = [np.flatnonzero(bins == b)[np.argmin(late_ms[bins == b])] for b in np.unique(bins)]
    return 1.0 + float(np.polyfit(sent_ms[earliest], late_ms[earliest], 1)[0])


def imu_seconds(shared_data: Path, clock: Clock = "tags") -> Floats:
    """Return the samples' times in seconds since 19:34:00 GPST."""
    rows, ends = load_imu(shared_data)
    start_s, tags = load_tags(shared_data)
    counter_s = (rows[:, 6] - rows[0, 6]) / 1000.0
    rate = tags[-1, 0] / 1000.0 / counter_s[-1] if clock == "published" else counter_rate(rows[:, 6], ends, tags)
    return start_s - DAY_START_S + IMU_OFFSET_S + counter_s * rate


def mounting() -> Floats:
    """Return R_bs: v_b = R_bs @ v_s, vehicle FRD from the sensor."""
    return Rotation.from_euler("ZYX", MOUNTING_RPY_DEG[::-1], degrees=True).as_matrix().T


def load_fixes(shared_data: Path) -> tuple[Ints, Floats]:
    """Return stamps and the columns of the .pos file from latitude on."""
    lines = (shared_data / "rtkx_drive" / "gnss_1934_sf.pos").read_text(encoding="ascii").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("%")]
    clocks = np.array([row[1].split(":") for row in rows], np.float64) @ [3600.0, 60.0, 1.0]
    return to_ns(clocks - DAY_START_S), np.array([row[2:] for row in rows], np.float64)


def to_ns(seconds: Floats) -> Ints:
    """Return seconds as whole nanoseconds."""
    return np.round(seconds * 1e9).astype(np.int64)


def write(shared_data: Path, out: Path, clock: Clock = "tags", velocity_age_s: float = 0.0) -> Path:
    """Write the sensor folder of the drive and return it."""
    rows, _ = load_imu(shared_data)
    R_sb = mounting().T
    t_ns = to_ns(imu_seconds(shared_data, clock))
    folder.write_imu(out, t_ns, np.radians(rows[:, 3:6]) @ R_sb, rows[:, :3] * G_M_S2 @ R_sb)
    _write_fixes(shared_data, out, "gnss", velocity_age_s)
    _write_fixes(shared_data, out, "reference", VELOCITY_AGE_S)
    folder.write_meta(out, "car", site={"date": DATE}, gnss={"lever_arm_b_m": LEVER_ARM_B_M})
    return out


def _write_fixes(shared_data: Path, out: Path, stem: str, velocity_age_s: float) -> None:
    """Write the fixes; velocities of another age than 0 go into rows of their own, that much earlier."""
    t_ns, pos = load_fixes(shared_data)
    where = folder.position_columns(pos[:, :3])
    motion = folder.velocity_columns(pos[:, 13:16] * [1.0, 1.0, -1.0])
    fix_type = {"fix_type": np.array([FIX_TYPE_OF_QUALITY.get(q, 3.0) for q in pos[:, 3].astype(int).tolist()])}
    if stem == "gnss":
        where |= {"h_acc_m": np.hypot(pos[:, 5], pos[:, 6]), "v_acc_m": pos[:, 7]}
        motion |= {"s_acc_m_s": np.hypot(pos[:, 16], pos[:, 17])}
    else:
        fix_type = {}
    if not velocity_age_s:
        folder.write_csv(out, stem, t_ns, where | motion | fix_type)
        return
    unknown = np.full(len(t_ns), np.nan)
    columns = {name: np.concatenate([values, unknown]) for name, values in where.items()}
    columns |= {name: np.concatenate([unknown, values]) for name, values in motion.items()}
    columns |= {name: np.tile(values, 2) for name, values in fix_type.items()}
    folder.write_csv(out, stem, np.concatenate([t_ns, t_ns - round(velocity_age_s * 1e9)]), columns)
