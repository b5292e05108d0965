"""The whole core as one object: a block of samples in, rows of every lane out, a snapshot on demand.

Samples are taken in order of arrival and the result does not depend on where the blocks are cut: preprocessing keeps
its open step, and a measurement waits for the step at whose end it is available. Settings that arrive in the stream
(the board's profile and date) act from their own place in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.codes import FUSED, GNSS, MAG
from server.nav.constants import NAV_RATE_MAX_HZ, NAV_RATE_MIN_HZ
from server.nav.controls import Controls
from server.nav.ekf import layout as at
from server.nav.field_learning import FieldLearning
from server.nav.health import mag_scale_event, sensor_health
from server.nav.lanes.bank import LaneBank
from server.nav.lanes.base import LaneContext
from server.nav.lanes.registry import LANES, LaneInfo
from server.nav.parts import Part, empty_block
from server.nav.preprocess.conditioning import Conditioning
from server.nav.preprocess.filtered import filtered_rows
from server.nav.preprocess.memory import S_MAG_SCALE
from server.nav.preprocess.withhold import USE_AIRSPEED, USE_BARO, USE_GNSS, USE_MAG, withhold
from server.nav.record import MAIN, Record
from server.nav.site import SiteFinder
from server.nav.types import (
    STEP_COLUMNS,
    EngineSettings,
    Event,
    FieldModel,
    Float,
    Kind,
    SampleBlock,
    Snapshot,
    StepResult,
    ToldDelay,
    VehicleClass,
)

DELAYED: Final = ("imu", "mag", "gnss", "baro")


class NavEngine(Controls):
    """Preprocessing and lanes of one board. Not shared between tasks."""

    def __init__(self, settings: EngineSettings, field_model: FieldModel) -> None:
        """Start before the first sample.

        Args:
            settings: what the user set.
            field_model: the magnetic model, called once per site.

        Raises:
            ValueError: a lane or parameter that does not exist, or a value outside its limits.
        """
        if not NAV_RATE_MIN_HZ <= settings.nav_rate_hz <= NAV_RATE_MAX_HZ:
            limits = f"{NAV_RATE_MIN_HZ:g} and {NAV_RATE_MAX_HZ:g}"
            raise ValueError(f"nav_rate_hz is {settings.nav_rate_hz}; it must lie between {limits}")
        self._settings, self._field_model = settings, field_model
        self._bank = LaneBank(settings)
        self._conditioning = Conditioning(settings.chain, settings.calibration)
        self._learning = FieldLearning()
        self._untold: list[Event] = []
        self._use = USE_GNSS * settings.use_gnss + USE_BARO * settings.use_baro
        self._use += USE_MAG * settings.use_mag + USE_AIRSPEED * settings.use_airspeed
        self._record = Record()
        self._boot_id = 0
        self._restart(0)

    def _restart(self, boot_id: int) -> None:
        """Forget everything that belongs to one power-up."""
        self._boot_id, self._t0_ns, self._started = boot_id, 0, False
        self._conditioning.restart()
        self._learning.restart()
        self._finder = SiteFinder(self._settings, self._field_model)
        self._delays_s = [0.0, 0.0, 0.0, 0.0]
        self._told_delays: tuple[ToldDelay, ...] = ()
        self._vehicle = int(self._settings.vehicle)
        self._held = np.full(5, np.nan)
        self._bank.clear()
        self._record.restart()
        self._steps = 0
        self._mag_scale_told = False

    def step(self, block: SampleBlock) -> StepResult:
        """Take samples in order of arrival; return all they completed, oldest first."""
        if block.boot_id != self._boot_id:
            self._restart(block.boot_id)
        if not self._started and len(block.t_ns):
            self._start(int(block.t_ns[0]))
        parts: list[Part] = [self._told_before()] if self._untold and len(block.t_ns) else []
        cuts = np.flatnonzero(block.kind >= Kind.DATE).tolist()
        if self._may_move:
            cuts = sorted({*cuts, *self._learning.cuts(block.kind, block.t_ns)})
        begin = 0
        for cut in (*cuts, len(block.kind)):
            while begin < cut:
                part, begin = self._advance(block, begin, cut)
                parts.append(part)
            if cut < len(block.kind) and block.kind[cut] >= Kind.DATE:
                self._configure(Kind(int(block.kind[cut])), block.data[cut])
                begin = cut + 1
            elif cut < len(block.kind):
                self._move_offset()
        return self._record.collect(block, parts, self._bank, self._finder.site)

    def finish(self) -> StepResult:
        """End the power-up: return the rows of the lanes that need all of it (`lanes.registry.AFTERWARDS`).

        Nothing may be stepped after it but another power-up.
        """
        part = Part()
        part.results = self._bank.finish(max(self._record.t_ns, self._t0_ns))
        return self._record.collect(empty_block(self._boot_id), [part], self._bank, self._finder.site)

    def _start(self, t0_ns: int) -> None:
        """Build the lanes: the kernels count time from the first sample."""
        self._t0_ns, self._started = t0_ns, True
        origin = self._settings.t_origin_ns if self._settings.t_origin_ns >= 0 else t0_ns
        held_back = np.array(self._settings.gnss_withheld_s, dtype=np.float64).reshape(-1, 2)
        self._withheld_ns = np.ascontiguousarray(np.rint(held_back * 1e9) + (origin - t0_ns))
        self._resolve_delays((math.nan,) * 4)
        self._bank.start(self._lane_context())

    def _mag_behind_imu_s(self) -> float:
        """Return how much older than the IMU's a magnetic sample of the same stamp is; NaN when nobody told."""
        return self._delays_s[1] - (self._lane_context().delays_s[0] if math.isfinite(self._delays_s[0]) else 0.0)

    def _lane_context(self) -> LaneContext:
        imu, mag, gnss, baro = self._delays_s
        filters_s = self._conditioning.imu_delay_s
        imu = imu if filters_s == 0.0 else filters_s + (imu if math.isfinite(imu) else 0.0)
        return LaneContext(
            settings=self._settings,
            t0_ns=self._t0_ns,
            delays_s=(imu, mag, gnss, baro),
            vehicle=self._vehicle,
            values={},
        )

    def choose_lanes(self, names: tuple[str, ...]) -> None:
        """Run these lanes from the next step on; those that run already go on undisturbed.

        Raises:
            ValueError: a lane that does not exist, one named twice, or none.
        """
        self._bank.choose(names)
        self._record.keep_only(names)

    def set_lane_parameters(self, lane: str, values: Mapping[str, float]) -> None:
        """Change parameters of one lane from the next step on.

        Raises:
            ValueError: unknown lane or parameter, or a value outside its limits; nothing is changed then.
        """
        self._bank.set_values(lane, values)

    def lanes(self) -> tuple[LaneInfo, ...]:
        """Return every lane there is: whether it runs, what it provides, and its parameters as they are set."""
        return self._bank.info()

    def covariance(self, lane: str) -> tuple[int, Float] | None:
        """Return (t_ns, P) of a lane that tells it, P (9, 9) over attitude, velocity and position NED; else None."""
        return self._bank.covariance(lane)

    def _resolve_delays(self, profile_s: tuple[float, ...]) -> None:
        """Settings win over the protocol's profile; NaN = nobody knows."""
        own = self._settings
        given = (own.imu_delay_s, own.mag_delay_s, own.gnss_delay_s, own.baro_delay_s)
        for i, (setting, profile) in enumerate(zip(given, profile_s, strict=True)):
            self._delays_s[i] = setting if math.isfinite(setting) else profile
        self._told_delays = tuple(
            ToldDelay(name=name, delay_s=delay_s, source="settings" if math.isfinite(setting) else "board")
            for name, delay_s, setting in zip(DELAYED, self._delays_s, given, strict=True)
            if math.isfinite(delay_s)
        )

    def _configure(self, kind: Kind, row: Float) -> None:
        """Take what the board says of itself."""
        if kind == Kind.DATE:
            if math.isnan(self._finder.board_year):
                self._finder.board_year = float(row[0])
            return
        self._finder.awaits_date = True
        self._resolve_delays((float(row[0]), float(row[1]), float(row[2]), float(row[3])))
        if self._settings.vehicle == VehicleClass.UNKNOWN and math.isfinite(row[4]):
            self._vehicle = int(row[4])
        self._bank.start(self._lane_context())

    def _advance(self, block: SampleBlock, begin: int, end: int) -> tuple[Part, int]:
        """Run preprocessing and lanes over rows [begin, end) of a block; return where it stopped."""
        got = self._conditioning.run(block, begin, end, self._t0_ns, self._settings.nav_rate_hz)
        part = Part()
        part.stages = got.stages
        if not self._mag_scale_told and len(got.seen):
            self._tell_mag_scale(got.seen, part)
        if len(got.steps):
            if self._learning.run:
                learned = self._conditioning.chain.learned_gauss
                self._learning.take(got.steps, got.meas, learned, self._t0_ns, self._mag_behind_imu_s())
            self._run_lanes(got.steps, got.meas, part)
        if self._conditioning.take_changed():
            self._bank.start(self._lane_context())
        return part, got.end

    def _tell_mag_scale(self, meas: Float, part: Part) -> None:
        """Say once, at the first magnetic sample, that its unit is not the protocol's."""
        field = meas[meas[:, at.M_KIND] == MAG]
        if len(field) and self._conditioning.memory[S_MAG_SCALE] != 0.0:
            self._mag_scale_told = True
            event = mag_scale_event(float(self._conditioning.memory[S_MAG_SCALE]), int(field[0, at.M_T]) + self._t0_ns)
            part.events += [event] if event else []

    def _run_lanes(self, steps: Float, meas: Float, part: Part) -> None:
        """Run every lane, in two halves when the site is settled in between."""
        self._steps += len(steps)
        withhold(meas, self._withheld_ns, float(np.nan_to_num(self._delays_s[2])), self._use)
        part.filtered = np.empty((len(steps), len(STEP_COLUMNS)))
        filtered_rows(steps, meas, self._held, part.filtered)
        part.t_ns = steps[:, at.U_T].astype(np.int64) + self._t0_ns
        begin = 0
        if self._finder.site is None:
            settled = self._find_site(steps, meas)
            if settled >= 0:
                self._run_some(steps, meas, 0, settled, part)
                begin = settled
                self._bank.set_site(self._finder.site)  # type: ignore[arg-type]  # just settled
        self._run_some(steps, meas, begin, len(steps), part)

    def _find_site(self, steps: Float, meas: Float) -> int:
        """Return the step before which the site is settled, −1 when it is not in this call."""
        first = 0 if self._finder.has_fix else self._first_fix(steps, meas)
        for k in range(first, len(steps)) if first >= 0 else ():
            if self._finder.settle(int(steps[k, at.U_T])) is not None:
                return k
        return -1

    def _first_fix(self, steps: Float, meas: Float) -> int:
        """Tell the finder the first fix that a lane may use; return its step, −1 when there is none."""
        good = meas[(meas[:, at.M_KIND] == GNSS) & (meas[:, at.M_STATUS] == FUSED)]
        for m in good:
            k = int(m[at.M_STEP])
            lat_deg, lon_deg, alt_m = m[at.M_DATA : at.M_DATA + 3].tolist()
            if self._finder.take_fix(lat_deg, lon_deg, alt_m, int(steps[k, at.U_T])):
                return k
        return -1

    def _run_some(self, steps: Float, meas: Float, begin: int, end: int, part: Part) -> None:
        """Run every lane over steps [begin, end)."""
        if end <= begin:
            return
        first, last = np.searchsorted(meas[:, at.M_STEP], (begin, end))
        own = meas[first:last]
        if begin:
            own = own.copy()
            own[:, at.M_STEP] -= begin
        part.results += self._bank.step(steps[begin:end], own, part.t_ns[begin:end])

    def snapshot(self) -> Snapshot:
        """Return the newest state of everything; built now, from what the engine holds."""
        return Snapshot(
            boot_id=self._boot_id,
            t_ns=self._record.t_ns,
            lanes=tuple(self._record.newest.values()),
            sensors=sensor_health(self._conditioning.memory, self._conditioning.counters, self._t0_ns),
            aids=self._record.aids(),
            site=self._finder.site,
            filtered=self._record.filtered,
            events=tuple(self._record.events),
            steps=self._steps,
            vehicle=VehicleClass(self._vehicle),
            delays=self._bank.delays(),
            mag_bias=self._bank.mag_bias(),
            told_delays=self._told_delays,
            filter_delays=self._conditioning.delays(),
            consistency=self._record.consistency() if MAIN in self._bank.chosen else (),
        )


def warm() -> None:
    """Load every compiled kernel, so that the first sample does not wait for one."""
    kind = np.array([Kind.IMU] * 3, dtype=np.uint8)
    data = np.zeros((3, 14))
    data[:, 5] = -9.8
    t_ns = np.array([0, 20_000_000, 40_000_000], dtype=np.int64)
    block = SampleBlock(kind=kind, t_ns=t_ns, t_rx_ns=t_ns, data=data)

    def no_field(lat_deg: float, lon_deg: float, alt_m: float, decimal_year: float) -> tuple[Float, float]:
        return np.array([0.2, 0.0, 0.4]), decimal_year

    NavEngine(EngineSettings(), no_field).step(block)


__all__ = ["LANES", "NavEngine", "warm"]
