"""Tilt from gravity: the integral of what is not gravity is a velocity, and a velocity is bounded.

An acceleration that lasts is therefore a tilt error, one that comes back is motion: there is no low-pass to choose, the
filter weighs the two by what it knows. The velocity is taken as an Ornstein-Uhlenbeck process of variance σ² and time
constant τ; to observe it as zero with white noise of the same power at low frequencies, 2 σ² τ, needs no state for it.
"""

from __future__ import annotations

from typing import Final

from server.nav.ekf.attitude.layout import S_B_DT, S_H, S_P, S_X, VEL, N
from server.nav.ekf.attitude.parameters import K_SPEED_SIGMA, K_SPEED_TIME
from server.nav.ekf.attitude.update import clear_row, fuse
from server.nav.kernel import kernel
from server.nav.types import Float

SURPRISE: Final = 4.0
"""Two standard deviations, squared: a speed beyond them is real, and loosens the bound."""


@kernel("void(float64[::1], float64[::1])")
def fuse_bounded_velocity(s: Float, par: Float) -> None:
    """Observe the velocity as zero within what a body without GNSS may have."""
    unexplained = 0.0
    for i in range(3):
        unexplained += (s[S_X + VEL + i] ** 2 - SURPRISE * s[S_P + (N + 1) * (VEL + i)]) / 3.0
    variance = (par[K_SPEED_SIGMA] ** 2 + max(0.0, unexplained)) * 2.0 * par[K_SPEED_TIME] / s[S_B_DT]
    for i in range(3):
        clear_row(s)
        s[S_H + VEL + i] = 1.0
        fuse(s, -s[S_X + VEL + i], variance)
