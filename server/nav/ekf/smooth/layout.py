"""Columns of the smoother's arrays: the recorded way of the filter, its log, and what is carried back."""

from __future__ import annotations

from typing import Final

from server.nav.ekf.states import N

# Where the recording stands.
T_NEXT: Final = 0  # number of the next slot to record
T_LINKED: Final = 1  # the slot before is there to go on from
T_POSITIONED: Final = 2
T_GNSS: Final = 3  # last GNSS position used, ns
T_END: Final = 4  # end of the slot before, ns
T_BOUNDARIES: Final = 5  # places, after the first alignment, that nothing later tells anything across
T_RESETS: Final = 6  # positions or headings set instead of corrected
T_SIZE: Final = 7

# One recorded slot.
Z_LINKED: Final = 0  # follows the slot before it by the prediction in z_f
Z_POSITIONED: Final = 1
Z_GNSS: Final = 2  # last GNSS position used, ns
Z_GNSS_HERE: Final = 3
Z_LOG_END: Final = 4  # entries of the log up to and with this slot's
Z_WAS_POSITIONED: Final = 5  # before this slot's measurements
Z_SIZE: Final = 6

# The prediction that leads to a slot: f·dt NED, A = R_nb·dt row by row, dt (`derivation`), and of the slow errors …
F_DT: Final = 12
F_DTHETA: Final = 13  # (3) rotation over the step, rad, which the errors of the gyro's scale and axes multiply
F_WANDER: Final = 16  # share of the receiver's slow error that is left after the step
F_JITTER: Final = 17  # and of its quick one
F_SIZE: Final = 18

# One entry of the log.
L_KIND: Final = 0
L_TURN: Final = 1  # rad by which the tilt error turned after it (`update.rotate_tilt`)
L_INNOVATION: Final = 2
L_VARIANCE: Final = 3
L_H: Final = 4  # (N); of a forgetting entry: 1 for the states that are forgotten
L_PH: Final = 4 + N  # (N)
L_SIZE: Final = 4 + 2 * N
SCALAR: Final = 0.0
FORGET: Final = 1.0
DATUM: Final = 2.0
"""The baro's datum was set from the height: what tells of the one tells of the other."""

LOG_ROOM: Final = 96
"""Scalars one slot can log: sixteen measurements of six."""

# What the pass carries from a step to the one before it, beside λ and Λ.
B_LINKED: Final = 0  # the step after this one follows from it
B_FUTURE: Final = 1  # a later GNSS position holds this step
B_LATER: Final = 2  # this stretch gets a position, now or later
B_SIZE: Final = 3
