"""One board that somebody looks at: reads its hub at the frame rate and shows its viewers the newest state only."""

from __future__ import annotations

import asyncio
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from server.hub import Subscription
from server.nav.types import SAMPLE_COLUMNS, Kind, StepResult, VehicleClass
from server.view3d.feed import IDENTITY, BoardFeed, Pose, Vec3, pose_from_row
from server.view3d.lead import Lead
from server.view3d.senses import Senses
from server.view3d.trail import Track
from server.view3d.viewer import Viewer

if TYPE_CHECKING:
    from collections.abc import Callable

    from server.calibration.scene import CalibrationScene

FRAME_HZ: Final = 25.0
"""Half the default navigation rate, so that frames are evenly spaced: 30 Hz would beat against 50 Hz and judder."""

FRAMES_PER_SURVEY: Final = 5
FRAMES_PER_JOB: Final = 10
"""A calibration is asked about 2.5 times a second: up to 1500 points are gone through each time."""

MAX_RESULTS: Final = 64  # a board in a burst loses its oldest; only the newest pose is shown anyway
_H_ACC: Final = SAMPLE_COLUMNS[Kind.GNSS].index("h_acc_m")
_CLASS: Final = SAMPLE_COLUMNS[Kind.PROFILE].index("vehicle_class")


class Stage:
    """Runs from the first viewer's arrival until the last has left; then nothing of it remains but the track."""

    def __init__(
        self,
        board: BoardFeed,
        track: Track,
        kind: VehicleClass,
        scene_of: Callable[[str], CalibrationScene | None] | None = None,
    ) -> None:
        self.board = board
        self.track = track
        self._given = kind
        self.viewers: set[Viewer] = set()
        self._results: Subscription[StepResult] | None = None
        self._lead = Lead()
        self._h_acc_m = math.nan
        self._scene_of = scene_of
        self._senses = Senses()

    @property
    def kind(self) -> VehicleClass:
        """Class of vehicle to draw: the settings' word, else the board's own."""
        return self._given or self.track.kind

    async def run(self) -> None:
        """Show frames until cancelled; subscribed only while a viewer is active."""
        loop = asyncio.get_running_loop()
        due_s, count = loop.time(), 0
        try:
            while True:
                due_s = max(due_s + 1.0 / FRAME_HZ, loop.time())
                await asyncio.sleep(due_s - loop.time())
                self._attend(survey=count % FRAMES_PER_SURVEY == 0)
                if count % FRAMES_PER_JOB == 0:
                    self._calibrate()
                count += 1
        finally:
            self._leave()

    def _attend(self, *, survey: bool) -> None:
        active = [viewer for viewer in self.viewers if viewer.active]
        if not active:
            self._leave()
            return
        if self._results is None:
            self._results = self.board.hub.results.subscribe(MAX_RESULTS)
            for viewer in active:
                self.welcome(viewer)
        self._show(active, self._results.drain())
        for viewer in active if survey else ():
            viewer.draw_as(self.kind)
            viewer.survey(self.track, self._lead.place, self._newest_fix(), self._h_acc_m)

    def _show(self, active: list[Viewer], results: list[StepResult]) -> None:
        for result in results:
            self._note(result)
        self._lead.choose(self.board.main_lane, self.track)
        pose = self._lead.follow(results)
        if pose is not None:
            attitudes = self._attitudes(results)
            for viewer in active:
                viewer.frame(pose, 1.0 / FRAME_HZ, attitudes)
        students = [viewer for viewer in active if viewer.calibrates]
        if students:
            self._hold(students, pose or self._lead.pose(), results)

    def _hold(self, students: list[Viewer], pose: Pose | None, results: list[StepResult]) -> None:
        """Show who looks at a calibration how the vehicle is held: by the main lane, else by gravity."""
        for result in results:
            self._senses.take(result.block)
        q_nb = pose.q_nb if pose is not None and pose.turned else self._senses.q_nb
        mag_b_gauss = self._senses.mag_b_gauss(self.board.mag_scale)
        for viewer in students if q_nb is not None else ():
            viewer.hold(q_nb or IDENTITY, mag_b_gauss)

    def _calibrate(self) -> None:
        """Ask how far the calibration is only while somebody looks at it."""
        students = [viewer for viewer in self.viewers if viewer.active and viewer.calibrates]
        job = self._scene_of(self.board.id) if students and self._scene_of is not None else None
        for viewer in students:
            viewer.calibrate(job)

    def _attitudes(self, results: list[StepResult]) -> dict[str, Pose]:
        """Return the newest attitude of every lane that knows nothing else, as fresh as the vehicle's own."""
        poses = {lane: self.track.poses[lane] for lane in self.track.attitudes if lane in self.track.poses}
        newest = {rows.lane: rows.data[-1] for result in results for rows in result.lanes if len(rows.t_ns)}
        return {lane: pose_from_row(newest[lane]) if lane in newest else pose for lane, pose in poses.items()}

    def _newest_fix(self) -> Vec3 | None:
        fixes = self.track.fixes
        if not fixes.count:
            return None
        n, e, d = fixes.points[-1, :3].tolist()
        return n, e, d

    def _note(self, result: StepResult) -> None:
        block = result.block
        kinds = block.kind
        gnss = np.flatnonzero(kinds == Kind.GNSS)
        if gnss.size:
            self._h_acc_m = float(block.data[gnss[-1], _H_ACC])
        profile = np.flatnonzero(kinds == Kind.PROFILE)
        if profile.size and block.data[profile[-1], _CLASS] in iter(VehicleClass):
            self.track.kind = VehicleClass(int(block.data[profile[-1], _CLASS]))

    def welcome(self, viewer: Viewer) -> None:
        """Show a viewer what is known, without waiting for the next sample."""
        self._lead.choose(self.board.main_lane, self.track)
        pose = self._lead.pose()
        if pose is not None:
            viewer.frame(pose, 0.0)

    def _leave(self) -> None:
        if self._results is not None:
            self._results.close()
            self._results = None
            self._lead = Lead()  # what it knew is old when somebody looks again
