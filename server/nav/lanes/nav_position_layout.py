"""Columns of the arrays that the kernels of `nav_position` share: memory, parameters, the past."""

from __future__ import annotations

from typing import Final

# Memory.
F_RUN: Final = 0  # 1 = position and velocity are valid
F_T_GNSS: Final = 1  # validity of the last fix used, ns
F_GNSS_REFUSED: Final = 2  # fixes refused in a row
F_BARO_REFUSED: Final = 3
F_BARO: Final = 4  # validity of the last baro height used; NEVER_NS = no offset yet
F_INTERVAL: Final = 5  # mean between fixes, s
F_GRAVITY: Final = 6
F_SITE: Final = 7  # (3) latitude rad, longitude rad, height m; NaN unknown
F_ACCEL: Final = 10  # (3) NED acceleration over the last step, error removed, m/s²
F_SIZE: Final = 13

# Parameters.
G_IMU_DELAY: Final = 0
G_GNSS_DELAY: Final = 1
G_BARO_DELAY: Final = 2
G_LEVER: Final = 3  # (3)
G_CORRELATION: Final = 6
G_DRIFT: Final = 7
G_OWN: Final = 8
G_ACCEL: Final = 8
G_ERROR: Final = 9
G_ERROR_TAU: Final = 10
G_ERROR_DOWN: Final = 11
G_POSITION: Final = 12
G_HEIGHT: Final = 13
G_VELOCITY: Final = 14
G_BARO: Final = 15
G_GATE: Final = 16
G_REACCEPT: Final = 17
G_SIZE: Final = 18

# The past, one row a step.
H_T: Final = 0
H_POS: Final = 1  # (3) of the IMU, NED from the site
H_VEL: Final = 4  # (3)
H_ARM: Final = 7  # (3) from the IMU to the antenna, NED
H_ARM_VEL: Final = 10  # (3) velocity of the antenna about the IMU, NED
H_SIZE: Final = 13
