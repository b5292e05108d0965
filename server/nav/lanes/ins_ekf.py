"""The main lane: error-state Kalman filter over attitude, velocity, position and the inertial sensors' biases."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from server.nav.ekf import defaults
from server.nav.ekf import layout as at
from server.nav.ekf.align import turn_about_down
from server.nav.ekf.blocks import fuse_field_model, start_field, turn_field
from server.nav.ekf.delays import start_delays
from server.nav.ekf.pseudo import BATCH
from server.nav.ekf.run import run
from server.nav.ekf.states import FIELD, INERTIAL, MAG_BIAS, PACKED, POS, X_MAG_BIAS, X_POS, X_Q, X_SIZE, packed
from server.nav.ekf.yaw_bank import new_bank
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.ins_ekf_attitude import SIGMA, AttitudeMode
from server.nav.lanes.ins_ekf_events import event
from server.nav.lanes.ins_ekf_parameters import PARAMETERS, kernel_parameters
from server.nav.lanes.ins_ekf_rebase import rebase_attitude, rebase_filter
from server.nav.preprocess.rebase import Rebase
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    AidRows,
    DelayState,
    Event,
    Float,
    Int,
    LaneRows,
    LaneStatus,
    Site,
)

NEVER_YET: Final = (
    at.A_T_GNSS, at.A_T_GNSS_SEEN, at.A_T_START, at.A_T_ASTRAY, at.A_T_RESET, at.A_T_MAG, at.A_T_BARO, at.A_T_STILL,
    at.A_T_RATE, at.A_T_GRAVITY, at.A_T_WHEELS, at.A_T_AIRSPEED, at.A_T_SIDESLIP, at.A_T_QUICK,
    at.A_T_DRAG,
)  # fmt: skip


class InsEkf:
    """Owns the filter's arrays and nothing else; `ekf.run.run` computes."""

    name: ClassVar[str] = "ins_ekf"
    provides: ClassVar[Provides] = "full"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        settings = context.settings
        slots = max(16, math.ceil(defaults.HISTORY_S * settings.nav_rate_hz))
        self._t0_ns = context.t0_ns
        self._par = kernel_parameters(context)
        self._x, self._P = np.zeros(X_SIZE), np.zeros(PACKED)
        self._x[X_Q] = 1.0
        self._aux, self._ctl = np.zeros(at.A_SIZE), np.zeros(at.C_SIZE, dtype=np.int64)
        for index in NEVER_YET:
            self._aux[index] = at.NEVER_NS
        for index in (at.A_K_POS, at.A_K_VEL, at.A_K_ALT, at.A_K_BARO, at.A_K_MAG, at.A_K_DRAG):
            self._aux[index] = 1.0
        self._aux[at.A_GNSS_INTERVAL] = 1.0
        self._aux[at.A_GRAVITY] = 9.80665
        self._aux[at.A_REST_HEIGHT] = self._aux[at.A_TEMPERATURE] = math.nan
        self._work, self._h = np.zeros(at.W_SIZE), np.zeros(at.H_SIZE)
        self._work[at.W_DIM] = INERTIAL
        self._r_u, self._r_x = np.zeros((slots, at.U_SIZE)), np.zeros((slots, X_SIZE + at.DELAYS * at.SENS))
        self._r_P = np.zeros((slots, PACKED))
        self._r_m = np.zeros((slots, at.SLOT_MEASUREMENTS, at.H_SIZE))
        self._r_n = np.zeros(slots, dtype=np.int64)
        self._bank = new_bank()
        self._unknown = (False, False)
        self._choose_delays(context)
        self._attitude = AttitudeMode(context)
        self._pending: list[Event] = []
        self._t_ns = 0
        self._sigma_rad = np.full(3, np.nan)

    def configure(self, context: LaneContext) -> None:
        """Take other parameters from the next step on."""
        self._par = kernel_parameters(context)
        self._choose_delays(context)
        self._attitude.configure(context)

    def _choose_delays(self, context: LaneContext) -> None:
        """Estimate the delays that neither settings nor the protocol told."""
        _, mag, gnss, _ = context.delays_s
        unknown = (math.isnan(gnss), math.isnan(mag))
        if unknown != self._unknown:
            start_delays(self._work, unknown)
            self._unknown = unknown

    def set_site(self, site: Site) -> None:
        """Take the origin and, where the model gave one, the field; a heading held against magnetic north turns."""
        aux, ctl = self._aux, self._ctl
        self._attitude.set_site(site)
        aux[at.A_SITE : at.A_SITE + 3] = math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m
        self._x[X_POS : X_POS + 3] = aux[at.A_SITE : at.A_SITE + 3]
        ctl[at.C_HAS_SITE] = 1
        magnetic = ctl[at.C_HAS_HEADING] and aux[at.A_FIELD_H] > 0.0  # a course heading is true already
        if site.field_n_gauss:
            north, east, down = site.field_n_gauss
            aux[at.A_DECLINATION], aux[at.A_FIELD_D] = site.declination_rad, down
            aux[at.A_FIELD_H], ctl[at.C_HAS_FIELD] = math.hypot(north, east), 1
            if ctl[at.C_MODE] == LaneStatus.ALIGNING or not magnetic:
                if self._P[packed(FIELD, FIELD)] > 0.0:
                    start_field(self._x, self._P, self._par, aux, ctl)
            else:
                turn_about_down(self._x, self._P, site.declination_rad)
                variance = self._par[at.PAR_DECLINATION_SIGMA] ** 2
                turn_field(self._x, self._P, site.declination_rad, variance)
                fuse_field_model(self._x, self._P, self._par, aux, self._work)
                t_ns = int(self._r_u[self._newest(), at.U_T]) + self._t0_ns
                self._pending.append(event(at.E_YAW_RESET, t_ns, site.declination_rad, 0.0))
        if ctl[at.C_VALID] > 0:  # what is older was held in the other frame and cannot be re-run
            self._r_x[self._newest(), :X_SIZE], self._r_P[self._newest()] = self._x, self._P
            self._r_n[self._newest()] = 0  # they are in the state already
            ctl[at.C_VALID] = 1

    def rebase(self, change: Rebase) -> None:
        """Move biases, history and running means to another calibration: the solution goes on without a jump."""
        rebase_filter(change, self._x, self._aux, self._ctl, self._r_u, self._r_x, self._r_m)
        rebase_attitude(change, self._attitude.memory)

    def covariance(self) -> tuple[int, Float] | None:
        """Return (t_ns, P) of the newest row, P (9, 9): attitude rad, velocity m/s, position m, NED; None before.

        Without position the attitude mode is what is published, and only its σ are known.
        """
        P = np.full((POS + 3, POS + 3), np.nan)
        if self._ctl[at.C_POSITIONED]:
            lower = np.zeros_like(P)
            lower[np.tril_indices(POS + 3)] = self._P[: packed(POS + 3, 0)]
            P = lower + np.tril(lower, -1).T
        elif np.isfinite(self._sigma_rad).all():
            P[:3, :3] = np.diag(self._sigma_rad**2)
        else:
            return None
        return self._t_ns, P

    def mag_bias(self) -> tuple[float, ...]:
        """Return the magnetic bias of the calibrated field, body, gauss (3), and its σ (3); () before it is one."""
        variance = [float(self._P[packed(MAG_BIAS + i, MAG_BIAS + i)]) for i in range(3)]
        if not self._ctl[at.C_POSITIONED] or min(variance) <= 0.0:
            return ()
        return (*self._x[X_MAG_BIAS : X_MAG_BIAS + 3].tolist(), *(math.sqrt(one) for one in variance))

    def _newest(self) -> int:
        return int(self._ctl[at.C_HEAD] - 1) % len(self._r_u)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        n = len(steps)
        rows = np.empty((n, len(LANE_COLUMNS)))
        most = 3 * len(meas) + (4 + 2 * BATCH) * n
        aids, aid_t = np.empty((most, len(AID_COLUMNS))), np.empty(most)
        events = np.empty((4 * n + len(meas) + 4, at.E_SIZE))
        self._ctl[at.C_AIDS] = self._ctl[at.C_EVENTS] = 0
        run(
            steps, meas, self._x, self._P, self._par, self._aux, self._ctl, self._work,
            self._r_u, self._r_x, self._r_P, self._r_m, self._r_n, rows, aids, aid_t, events, self._h, self._bank,
        )  # fmt: skip
        self._t_ns = int(t_ns[-1]) if n else self._t_ns
        k = int(self._ctl[at.C_AIDS])
        aid_rows = AidRows(t_ns=aid_t[:k].astype(np.int64) + self._t0_ns, data=aids[:k])
        aid_rows.data[:, 15] += self._t0_ns
        found = self._pending + [
            event(int(e[0]), int(e[1]) + self._t0_ns, e[2], e[3]) for e in events[: self._ctl[at.C_EVENTS]]
        ]
        self._pending = []
        handed_over = self._attitude.fill(steps, meas, rows)
        if handed_over:
            k, angle = handed_over
            found.append(event(at.E_HANDOVER, int(t_ns[k]), angle, 0.0))
        if n:
            self._sigma_rad = rows[-1, SIGMA : SIGMA + 3].copy()
        found.sort(key=lambda e: e.t_ns)
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows), aids=aid_rows, events=tuple(found))

    def delays(self) -> tuple[DelayState, ...]:
        """Return the delays found on line so far, with their standard deviations; () when all were told."""
        work, names = self._work, ("gnss_position", "gnss_velocity", "mag")
        asked = (self._unknown[0], self._unknown[0], self._unknown[1])
        return tuple(
            DelayState(
                name=name,
                delay_s=float(work[at.W_USED + i] + work[at.W_DELTA + i]),
                sigma_s=float(np.sqrt(work[at.W_M + i * (at.DELAYS + 1)])),
            )
            for i, (name, unknown) in enumerate(zip(names, asked, strict=True))
            if unknown
        )
