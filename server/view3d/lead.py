"""Which lanes the vehicle follows: the chosen main lane, and where that has no position, another one's place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from server.nav.types import StepResult
from server.view3d.feed import MAIN_LANE, PASS_THROUGH, Pose, pose_from_row
from server.view3d.trail import Track


class Lead:
    """The vehicle's pose, out of the newest rows of at most two lanes.

    It turns with the main lane and stands where that says. A main lane without a position (attitude alone, or no fix
    yet) stands where the first lane says that has one: estimators first, what repeats others last.

    Attributes:
        turns: lane that the vehicle turns with; None while none knows its attitude.
        place: lane on whose path the vehicle is; None while none could have one.
    """

    def __init__(self) -> None:
        self.turns: str | None = None
        self.place: str | None = None
        self._poses: dict[str, Pose] = {}

    def choose(self, main: str, track: Track) -> None:
        """Decide which lanes to follow, after what the newest snapshot knew of them."""
        poses, lanes = track.poses, _in_order(main, track.poses)
        placed = [lane for lane in lanes if poses[lane].known] or [lane for lane in lanes if lane in track.lanes]
        turned = [lane for lane in lanes if poses[lane].turned]
        self.place = placed[0] if placed else None
        self.turns = next((lane for lane in (main, self.place, *turned) if lane in turned), None)
        self._poses = {
            lane: self._poses.get(lane, poses[lane]) for lane in (self.turns, self.place) if lane is not None
        }

    def follow(self, results: Sequence[StepResult]) -> Pose | None:
        """Return the vehicle's newest pose; None when these results say nothing of it."""
        newer = False
        for rows in (rows for result in results for rows in result.lanes if rows.lane in self._poses):
            for row in rows.data if rows.lane in PASS_THROUGH else rows.data[-1:]:
                self._poses[rows.lane] = _completed(pose_from_row(row), self._poses[rows.lane])
                newer = True
        return self.pose() if newer else None

    def pose(self) -> Pose | None:
        """Return the vehicle's pose as it was last; None while nothing is known."""
        turns, place = self._poses.get(self.turns or ""), self._poses.get(self.place or "")
        return _turned_as(turns, place) if turns is not None and place is not None else turns or place


def _in_order(main: str, lanes: Iterable[str]) -> list[str]:
    """Return the lanes, the one to follow first."""
    return sorted(lanes, key=lambda lane: (lane != main, lane != MAIN_LANE, lane in PASS_THROUGH))


def _turned_as(turns: Pose, place: Pose) -> Pose:
    return replace(place, q_nb=turns.q_nb, turned=turns.turned, sigma_att_rad=turns.sigma_att_rad)


def _completed(pose: Pose, before: Pose) -> Pose:
    """Return a pose with what its row left out as it was: attitude and position come in turns."""
    whole = pose if pose.turned else _turned_as(before, pose)
    if pose.known or not before.known:
        return whole
    return replace(
        whole,
        known=True,
        pos_n_m=before.pos_n_m,
        sigma_pos_n_m=before.sigma_pos_n_m,
        speed_m_s=before.speed_m_s,
    )
