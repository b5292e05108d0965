"""Learning the magnetometer's offset while the vehicle moves: how large, how sure, and whether it may be believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.calibration import learning_layout as at
from server.nav.calibration.learning_run import run
from server.nav.types import Float

CONVERGED_GAUSS: Final = 0.015  # 1 σ on every axis: 2° of heading in a field of 0.4 gauss
STILL_S: Final = 0.4
FEW_TURNS_S: Final = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MagLearnState:
    """What has been learned.

    Attributes:
        t_ns: board time of the newest step; −1 before the first.
        offset_gauss: shape (3,), body: calibrated = (as given) − offset.
        sigma_gauss: shape (3,), one standard deviation.
        excitation: shape (3,), 0 to 1 per axis: 1 − exp(−turning across this axis since the offset last changed, rad).
        converged: sure to `CONVERGED_GAUSS` on every axis, and nothing contradicts.
        frozen: nothing is learned at present; reason: "rest", "room" (the field contradicts every constant offset tried
            so far), "few-turns" (it moves, but hardly turns), "".
        changes: offsets that were given up for another; t_changed_ns: when the last of them began, −1 never.
        residual_gauss: RMS of what the strength |field − offset| varies by under the best constant offset: place,
            noise, soft iron. Weighed with a first guess, NaN before the first turn.
        contradicted: constant offsets that were tried and failed since the field contradicts; 0 when it does not.
        gyro_bias_rad_s, delay_s: found along the way; for people.
    """

    t_ns: int
    offset_gauss: Float
    sigma_gauss: Float
    excitation: Float
    converged: bool
    frozen: bool
    reason: str
    changes: int
    t_changed_ns: int
    residual_gauss: float
    contradicted: int
    gyro_bias_rad_s: Float
    delay_s: float


class MagLearner:
    """Owns the memory; a kernel computes. Not shared between tasks."""

    def __init__(
        self,
        t0_ns: int = 0,
        mag_delay_s: float = math.nan,
        offset_gauss: tuple[float, float, float] = (0.0, 0.0, 0.0),
        sigma_gauss: float = math.nan,
        parameters: Float | None = None,
    ) -> None:
        """Start before the first step.

        Args:
            t0_ns: board time that the steps count from.
            mag_delay_s: a sample stamped t is valid at t − delay; NaN = nobody knows.
            offset_gauss, sigma_gauss: what is known of the offset; NaN = nothing.
            parameters: `learning_layout.default_parameters`, changed.
        """
        self._t0_ns = t0_ns
        self._par = at.default_parameters() if parameters is None else parameters.copy()
        self.set_mag_delay(mag_delay_s)
        self.reset(offset_gauss, sigma_gauss)

    def set_mag_delay(self, mag_delay_s: float) -> None:
        """Take another delay of the magnetometer from the next sample on; NaN = nobody knows."""
        self._par[at.K_DELAY] = mag_delay_s if math.isfinite(mag_delay_s) else 0.0

    def reset(self, offset_gauss: tuple[float, float, float] = (0.0, 0.0, 0.0), sigma_gauss: float = math.nan) -> None:
        """Forget everything learned; start from this offset."""
        self._s, self._c = np.zeros((2, at.F_SIZE)), np.zeros(at.C_SIZE)
        sigma = sigma_gauss if math.isfinite(sigma_gauss) else float(self._par[at.K_OFFSET_SIGMA])
        self._s[0, at.F_X : at.F_X + 3] = offset_gauss
        for i in range(3):
            self._s[0, at.F_P + (at.N + 1) * i] = sigma**2
        self._c[at.C_Q] = self._c[at.C_A_Q] = 1.0
        self._c[at.C_T] = self._c[at.C_T_CHANGED] = self._c[at.C_T_TRUSTED] = at.NEVER_NS
        self._c[at.C_PATCH2] = self._c[at.C_RESIDUAL2] = self._par[at.K_PATCH] ** 2
        self._c[at.C_WHITE2] = self._par[at.K_NOISE] ** 2
        self._c[at.C_RING : at.C_HEAD : at.RING_COLUMNS] = at.NEVER_NS

    def step(self, steps: Float, meas: Float) -> None:
        """Advance over navigation steps and measurements.

        Args:
            steps: shape (n, U_SIZE), columns of `ekf.layout`.
            meas: shape (k, M_SIZE), M_STEP ascending in [0, n); only magnetic rows are used: gauss, calibrated but
                without what is learned here.
        """
        run(steps, meas, self._par, self._s, self._c)

    def state(self) -> MagLearnState:
        """Return what has been learned so far."""
        s, c = self._s[0], self._c
        sigma = np.sqrt(s[at.F_P : at.F_P + at.N * at.N].reshape(at.N, at.N).diagonal())
        started = c[at.C_T] > at.NEVER_NS
        reason = self._reason()
        suspect = bool(c[at.C_SUSPECT])
        return MagLearnState(
            t_ns=int(c[at.C_T]) + self._t0_ns if started else -1,
            offset_gauss=s[at.F_X : at.F_X + 3].copy(),
            sigma_gauss=sigma[:3].copy(),
            excitation=1.0 - np.exp(-c[at.C_TURNED : at.C_TURNED + 3]),
            converged=bool(sigma[:3].max() < CONVERGED_GAUSS) and not suspect,
            frozen=reason != "",
            reason=reason,
            changes=int(c[at.C_CHANGES]),
            t_changed_ns=int(c[at.C_T_CHANGED]) + self._t0_ns if c[at.C_CHANGES] else -1,
            residual_gauss=math.sqrt(max(0.0, c[at.C_RESIDUAL2])) if c[at.C_TURNED] > 0.0 else math.nan,
            contradicted=int(c[at.C_REFUSED]) if suspect else 0,
            gyro_bias_rad_s=s[at.F_X + at.GYRO : at.F_X + at.GYRO + 3].copy(),
            delay_s=float(s[at.F_X + at.DELAY]),
        )

    def _reason(self) -> str:
        c = self._c
        if c[at.C_STARTED] == 0.0 or c[at.C_STILL_S] > STILL_S:
            return "rest"
        if c[at.C_SUSPECT]:
            return "room"
        return "few-turns" if c[at.C_A_S] > FEW_TURNS_S else ""
