"""The five motions as tables [S4 §4 and S3's last figure, in numbers] and as a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from server.compare import curves
from server.compare.contract import FiveMotionsOut, MotionLaneOut, MotionOut
from server.compare.curves import View
from server.compare.figures import OPEN_NS
from server.compare.motions import ALTITUDE, FiveMotions, Moved
from server.compare.report import Report
from server.compare.table import Cell, Column
from server.compare.tables import DEG, Sheet, late_ms, scaled
from server.replay.contract import SpreadOut

POINTS: Final = 400

_ATTITUDE: Final = (
    Column(name="motion"),
    Column(name="lane"),
    Column(name="roll", unit="° RMS"),
    Column(name="pitch", unit="° RMS"),
    Column(name="worst", unit="°", meaning="largest error of roll or pitch"),
    Column(name="heading", unit="° RMS", meaning="a dash where nothing ties the lane's heading to north"),
    Column(name="late", unit="ms", right=True, meaning="body rates against the truth's"),
    Column(name="noise", unit="°", digits=4, meaning="of roll and pitch: RMS second difference / √6 while quiet"),
    Column(name="cost", unit="ns/step", digits=0, meaning="of one navigation step on this machine"),
)
_ALTITUDE: Final = (
    Column(name="motion"),
    Column(name="lane"),
    Column(name="height", unit="m RMS"),
    Column(name="worst", unit="m"),
    Column(name="climb", unit="m/s RMS", digits=3),
    Column(name="worst", unit="m/s", digits=3),
    Column(name="late", unit="ms", right=True, meaning="vertical speed against the truth's"),
    Column(name="noise", unit="m", digits=4, meaning="of the height: RMS second difference / √6 while quiet"),
    Column(name="cost", unit="ns/step", digits=0),
)


def words(motion: MotionOut) -> str:
    """Return a motion's name for people."""
    if motion.motion == ALTITUDE:
        disturbance_m = motion.baro_disturbance_m
        return f"baro misled by {disturbance_m:g} m" if disturbance_m else "baro not disturbed"
    return motion.motion.replace("_", " ")


def motion_sheets(out: FiveMotionsOut) -> list[Sheet]:
    """Return both tables."""
    return [attitude_sheet(out.attitude), altitude_sheet(out.altitude)]


def attitude_sheet(motions: Iterable[MotionOut]) -> Sheet:
    """Return motion × lane of everything that has an attitude."""
    rows = [
        [words(motion) if first else "", lane, *_attitude(one)]
        for motion in motions
        for first, lane, one in _marked(motion, lambda one: one.roll_rad is not None)
    ]
    return Sheet(title="Attitude over the five motions, against the truth", columns=_ATTITUDE, rows=rows)


def altitude_sheet(motions: Iterable[MotionOut]) -> Sheet:
    """Return motion × lane of everything that has a height, with and without the disturbance."""
    rows = [
        [words(motion) if first else "", lane, *_altitude(one)]
        for motion in motions
        for first, lane, one in _marked(motion, lambda one: one.height_m is not None)
    ]
    return Sheet(title="Height under aggressive motion, against the truth", columns=_ALTITUDE, rows=rows)


def _marked(motion: MotionOut, has: Callable[[MotionLaneOut], bool]) -> list[tuple[bool, str, MotionLaneOut]]:
    """Return the lanes that have it, the first one marked."""
    found = [(lane, one) for lane, one in motion.lanes.items() if has(one)]
    return [(place == 0, lane, one) for place, (lane, one) in enumerate(found)]


def _attitude(one: MotionLaneOut) -> list[Cell]:
    late = one.delay.attitude if one.delay else None
    worst = max((part.max for part in (one.roll_rad, one.pitch_rad) if part is not None), default=None)
    return [
        scaled(_rms(one.roll_rad), DEG),
        scaled(_rms(one.pitch_rad), DEG),
        scaled(worst, DEG),
        scaled(_rms(one.heading_rad), DEG),
        late_ms(late),
        scaled(one.noise.tilt_rad, DEG) if one.noise else None,
        one.cost.ns_per_step if one.cost else None,
    ]


def _altitude(one: MotionLaneOut) -> list[Cell]:
    late = one.delay.vertical if one.delay else None
    return [
        _rms(one.height_m),
        one.height_m.max if one.height_m else None,
        _rms(one.vertical_m_s),
        one.vertical_m_s.max if one.vertical_m_s else None,
        late_ms(late),
        one.noise.height_m if one.noise else None,
        one.cost.ns_per_step if one.cost else None,
    ]


def _rms(part: SpreadOut | None) -> float | None:
    return part.rms if part is not None else None


def motion_page(found: FiveMotions) -> str:
    """Return the report as one HTML file."""
    report = Report("navdeck compare: five motions")
    report.text(
        f"Every lane on the very same samples of motions that carry their truth, seed {found.out.seed}; nothing is "
        "fitted. Late: the shift at which a lane's motion most resembles the truth's. Noise: RMS second difference / "
        "√6 in quiet seconds, which for white noise is its σ. Cost is measured on this machine.",
        *found.out.notes,
    )
    report.heading("Figures")
    for sheet in motion_sheets(found.out):
        report.table(sheet.columns, sheet.rows, title=sheet.title)
    for one in found.attitude:
        _attitude_plots(report, one)
    for one in found.altitude:
        _altitude_plots(report, one)
    return report.html()


def _view(one: Moved) -> View:
    wide = frozenset({"reference"})
    return View(t_origin_ns=one.t_origin_ns, window=(-OPEN_NS, OPEN_NS), points=POINTS, wide=wide)


def _attitude_plots(report: Report, one: Moved) -> None:
    view = _view(one)
    report.heading(words(one.out).capitalize())
    lanes = {name: lane for name, lane in one.lanes.items() if name == "reference" or _has_attitude(one, name)}
    report.panels(curves.attitude(lanes, view), title="Attitude", height_pt=160.0)
    errors = {name: lane.error for name, lane in lanes.items() if lane.error is not None and name != "reference"}
    report.panels(curves.sizes(errors, view)[:2], title="Error against the truth", columns=2, height_pt=180.0)


def _has_attitude(one: Moved, name: str) -> bool:
    return name in one.out.lanes and one.out.lanes[name].roll_rad is not None


def _altitude_plots(report: Report, one: Moved) -> None:
    view = _view(one)
    report.heading(f"Aggressive flight, {words(one.out)}")
    lanes = {
        name: lane
        for name, lane in one.lanes.items()
        if name == "reference" or (name in one.out.lanes and one.out.lanes[name].height_m is not None)
    }
    report.panels(curves.altitude(lanes, view), title="Height and climb", height_pt=180.0)
    errors = {name: lane.error for name, lane in lanes.items() if lane.error is not None and name != "reference"}
    vertical: Sequence[int] = (3, 5)
    panels = curves.sizes(errors, view)
    report.panels([panels[place] for place in vertical], title="Error against the truth", columns=2, height_pt=180.0)
