"""Where a board has been: bounded, thinned rather than cut, kept at a few hertz whether or not somebody looks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from server.nav.types import AID_COLUMNS, Aid, AidStatus, Float, Snapshot, VehicleClass
from server.view3d.feed import Pose, Vec3, pose_from_row

CHUNK: Final = 100
"""Points per scene node: a growing path then costs one chunk a change, not the whole path."""

PATH_CHUNKS: Final = 40
FIX_CHUNKS: Final = 8
STEP_M: Final = 0.1
"""A board that has moved less than this adds no point: a board on the desk keeps an empty path."""

_OBSERVATION = AID_COLUMNS.index("observation_0")
_STATUS = AID_COLUMNS.index("status")
_T_VALID = AID_COLUMNS.index("t_valid_ns")


class Trail:
    """A path of at most `chunks` × CHUNK points; when full, every second point goes and the spacing doubles.

    So a flight of any length stays whole, its memory and its number of scene nodes bounded. Columns of a point:
    north, east, down (m) and two values for its colour. `revision` changes when earlier points did.
    """

    def __init__(self, chunks: int) -> None:
        self._data = np.empty((chunks * CHUNK, 5))
        self._stride = 1
        self._skipped = 0
        self.count = 0
        self.revision = 0

    @property
    def points(self) -> Float:
        """The points so far, shape (count, 5); do not write, do not keep."""
        return self._data[: self.count]

    def add(self, point_n_m: Vec3, first: float, second: float) -> None:
        """Append a point, unless thinning skips it."""
        self._skipped += 1
        if self._skipped < self._stride:
            return
        self._skipped = 0
        if self.count == len(self._data):
            self._thin()
        self._data[self.count] = (*point_n_m, first, second)
        self.count += 1

    def moved(self, point_n_m: Vec3) -> bool:
        """True when the point lies off the last one by STEP_M or more, or is the first."""
        return self.count == 0 or math.dist(self._data[self.count - 1, :3], point_n_m) >= STEP_M

    def clear(self) -> None:
        """Forget everything."""
        self.count, self._stride, self._skipped = 0, 1, 0
        self.revision += 1

    def _thin(self) -> None:
        kept = self._data[::2].copy()
        self.count = len(kept)
        self._data[: self.count] = kept
        self._stride *= 2
        self.revision += 1


@dataclass(slots=True)
class Track:
    """What was seen of the lanes of one board that run now.

    Attributes:
        lanes: the path of every lane that knows a position.
        attitudes: lanes that know the attitude alone.
        fixes: GNSS fixes; colour values: 1 when fused, 0 when refused.
        poses: the newest of each of `lanes` and `attitudes`.
        kind: class of vehicle, as the board says.
    """

    lanes: dict[str, Trail] = field(default_factory=dict)
    attitudes: tuple[str, ...] = ()
    fixes: Trail = field(default_factory=lambda: Trail(FIX_CHUNKS))
    poses: dict[str, Pose] = field(default_factory=dict)
    kind: VehicleClass = VehicleClass.UNKNOWN
    _boot_id: int = -1
    _t_fix_ns: float = math.nan

    def take(self, snapshot: Snapshot) -> None:
        """Add the newest state of every lane; a new power-up starts over."""
        if snapshot.boot_id != self._boot_id:
            self._restart(snapshot.boot_id)
        self.kind = getattr(snapshot, "vehicle", VehicleClass.UNKNOWN) or self.kind
        self._forget_all_but({lane.lane for lane in snapshot.lanes})
        self.attitudes = tuple(lane.lane for lane in snapshot.lanes if lane.provides == "attitude")
        for lane in snapshot.lanes:
            if lane.provides != "altitude":
                self.poses[lane.lane] = pose_from_row(lane.row)
            if lane.provides == "full":
                self._extend(lane.lane, self.poses[lane.lane])
        for aid in snapshot.aids:
            if aid.aid == Aid.GNSS_POSITION and aid.last:
                self._mark(aid.last)

    def _forget_all_but(self, running: set[str]) -> None:
        """Drop what was kept of lanes that were switched off; before the first lane there is nothing to compare."""
        if not running:
            return
        for lane in self.lanes.keys() - running:
            del self.lanes[lane]
        for lane in self.poses.keys() - running:
            del self.poses[lane]

    def _extend(self, lane: str, pose: Pose) -> None:
        trail = self.lanes.setdefault(lane, Trail(PATH_CHUNKS))
        if pose.known and trail.moved(pose.pos_n_m):
            trail.add(pose.pos_n_m, pose.speed_m_s, math.hypot(*pose.sigma_pos_n_m[:2]))

    def _mark(self, record: tuple[float, ...]) -> None:
        n, e, d = record[_OBSERVATION : _OBSERVATION + 3]
        if record[_T_VALID] != self._t_fix_ns and math.isfinite(n + e + d):
            self._t_fix_ns = record[_T_VALID]
            self.fixes.add((n, e, d), float(record[_STATUS] == AidStatus.FUSED), math.nan)

    def _restart(self, boot_id: int) -> None:
        self._boot_id = boot_id
        for trail in (*self.lanes.values(), self.fixes):
            trail.clear()
        self.poses.clear()
