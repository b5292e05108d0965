"""Columns of the smoother's arrays: the recorded way of the filter, its log, and what is carried back."""

from __future__ import annotations

from typing import Final

from server.nav.ekf.states import N

# Where the recording stands.
T_NEXT: Final = 0  # number of the next slot to record
T_LINKED: Final = 1  # the slot before is there to go on from
T_POSITIONED: Final = 2
T_BARO_SEEN: Final = 3
T_BARO: Final = 4  # last baro height used, ns
T_DATUM_VAR: Final = 5  # of the baro's datum, m²
T_GNSS: Final = 6  # last GNSS position used, ns
T_END: Final = 7  # end of the slot before, ns
T_BOUNDARIES: Final = 8  # places, after the first alignment, that nothing later tells anything across
T_RESETS: Final = 9  # positions or headings set instead of corrected
T_SIZE: Final = 10

# One recorded slot.
Z_LINKED: Final = 0  # follows the slot before it by the prediction in z_f
Z_POSITIONED: Final = 1
Z_BARO_SEEN: Final = 2
Z_DATUM_VAR: Final = 3
Z_SHIFT: Final = 4  # of height and datum together at this slot, m up
Z_WANDER_VAR: Final = 5
Z_GNSS: Final = 6  # last GNSS position used, ns
Z_GNSS_HERE: Final = 7
Z_LOG_END: Final = 8  # entries of the log up to and with this slot's
Z_WAS_POSITIONED: Final = 9  # before this slot's measurements
Z_SIZE: Final = 10
F_SIZE: Final = 13
"""f·dt NED, A = R_nb·dt row by row, dt of the prediction that leads to the slot (`derivation`)."""

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
"""What was known of the height became what is known of the baro's datum; the variance is that of both."""

LOG_ROOM: Final = 96
"""Scalars one slot can log: sixteen measurements of six."""

# What the pass carries from a step to the one before it, beside λ and Λ.
B_LINKED: Final = 0  # the step after this one follows from it
B_SEEN: Final = 1  # … and used the baro
B_DATUM: Final = 2  # smoothed less filtered datum at the step after, m up
B_DATUM_VAR: Final = 3  # smoothed, there
B_SHIFT: Final = 4  # of the datum at the step after, m up
B_DT: Final = 5  # to the step after, s
B_FUTURE: Final = 6  # a later GNSS position holds this step
B_LATER: Final = 7  # this stretch gets a position, now or later
B_SIZE: Final = 8
