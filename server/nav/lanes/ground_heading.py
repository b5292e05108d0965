"""What motion over ground says of the attitude: GNSS velocities against what the accelerometer felt between them.

Specific force turned into NED by an attitude whose heading is wrong by ψ integrates to a horizontal velocity change
that is turned by ψ against the receiver's. Any vehicle that accelerates shows it, whichever way it points; a vehicle
that goes where it points (`course`) shows the heading itself. What is left over and does not turn is gravity, seen
through a tilt error: this is levelling that no acceleration disturbs. Fixes are late, so the sums are kept for a while.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.ekf.layout import M_DATA, U_DT, U_DVEL, U_T
from server.nav.kernel import kernel
from server.nav.lanes.attitude import S_OWN, S_Q, wrap
from server.nav.rotation import matrix_entries
from server.nav.types import Float

S_SLOT: Final = S_OWN  # steps noted since the last `forget_motion`
S_SUM: Final = S_OWN + 1  # (2) horizontal velocity felt since then, m/s
S_HAS_FIX: Final = S_OWN + 3
S_T_FIX: Final = S_OWN + 4  # stamp that the last fix belongs to, ns
S_FIX_FELT: Final = S_OWN + 5  # (2) the sum then
S_FIX_VEL: Final = S_OWN + 7  # (2) the receiver's velocity then
S_ALONG: Final = S_OWN + 9  # Σ felt · seen, (m/s)²
S_ACROSS: Final = S_OWN + 10  # Σ felt × seen
S_SINCE_FIX: Final = S_OWN + 11  # s since two fixes were last compared
SIZE: Final = S_OWN + 12

R_T: Final = 0  # ring columns: stamp ns, sums north and east m/s, heading rad
R_SIZE: Final = 4
HISTORY_S: Final = 1.0  # longest delay that is still compared at its own time
LONGEST_S: Final = 1.2  # a 1 Hz receiver's fixes still show one manoeuvre
AHEAD_NS: Final = 0.1e9  # a fix younger than the newest step by less is taken as of it

O_ANGLE: Final = 0  # what a fix shows: rad to turn clockwise, m/s² it is drawn from, s between the fixes …
O_ACCEL: Final = 1
O_SECONDS: Final = 2
O_COURSE: Final = 3  # … and course − heading rad, ground speed m/s
O_SPEED: Final = 4
O_TILT: Final = 5  # (2) NED rotation (north, east) rad that explains what was felt too much
O_CHANGE: Final = 7  # the receiver's own acceleration, m/s²
O_SIZE: Final = 8


@kernel("void(float64[::1])")
def forget_motion(s: Float) -> None:
    """Start the sums again: the heading jumped, or there was a hole."""
    for i in range(S_OWN, SIZE):
        s[i] = 0.0
    s[S_SINCE_FIX] = 2.0 * LONGEST_S


@kernel("void(float64[::1], float64[::1], float64[:, ::1])")
def note_step(u: Float, s: Float, ring: Float) -> None:
    """Add a step's velocity change, turned by the attitude at its start, which `s` still holds."""
    R = matrix_entries(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    s[S_SUM] += R[0] * u[U_DVEL] + R[1] * u[U_DVEL + 1] + R[2] * u[U_DVEL + 2]
    s[S_SUM + 1] += R[3] * u[U_DVEL] + R[4] * u[U_DVEL + 1] + R[5] * u[U_DVEL + 2]
    row = ring[int(s[S_SLOT]) % ring.shape[0]]
    row[R_T], row[R_T + 1], row[R_T + 2], row[R_T + 3] = u[U_T], s[S_SUM], s[S_SUM + 1], math.atan2(R[3], R[0])
    s[S_SLOT] += 1.0
    s[S_SINCE_FIX] += u[U_DT]


@kernel("UniTuple(float64, 4)(float64, float64[::1], float64[:, ::1])")
def _felt_at(t_ns: float, s: Float, ring: Float) -> tuple[float, float, float, float]:
    """Return (1, sums north, east, heading) at a stamp, 0 first when the ring does not reach it."""
    head, slots = int(s[S_SLOT]), ring.shape[0]
    if head < 2 or t_ns > ring[(head - 1) % slots, R_T] + AHEAD_NS:
        return 0.0, 0.0, 0.0, 0.0
    later = ring[(head - 1) % slots]
    for back in range(2, min(head, slots) + 1):
        row = ring[(head - back) % slots]
        if row[R_T] <= t_ns:
            a = min(1.0, (t_ns - row[R_T]) / (later[R_T] - row[R_T]))
            heading = row[R_T + 3] + a * wrap(later[R_T + 3] - row[R_T + 3])
            return 1.0, row[1] + a * (later[1] - row[1]), row[2] + a * (later[2] - row[2]), heading
        later = row
    return 0.0, 0.0, 0.0, 0.0


@kernel("boolean(float64[::1], float64, float64[::1], float64[:, ::1], float64[::1])")
def take_velocity(m: Float, t_ns: float, s: Float, ring: Float, out: Float) -> bool:
    """Compare a fix's velocity, valid at the stamp t, with the sums; return whether `out` (O_*) is filled."""
    north, east = m[M_DATA + 3], m[M_DATA + 4]
    known, felt_n, felt_e, heading = _felt_at(t_ns, s, ring)
    if known == 0.0 or not (math.isfinite(north) and math.isfinite(east)):
        s[S_HAS_FIX] = 0.0
        return False
    between_s = (t_ns - s[S_T_FIX]) * 1e-9
    ready = bool(s[S_HAS_FIX] != 0.0 and 0.0 < between_s <= LONGEST_S)
    if ready:
        fn, fe = felt_n - s[S_FIX_FELT], felt_e - s[S_FIX_FELT + 1]
        gn, ge = north - s[S_FIX_VEL], east - s[S_FIX_VEL + 1]
        along, across = fn * gn + fe * ge, fn * ge - fe * gn
        s[S_ALONG] += along
        s[S_ACROSS] += across
        out[O_ANGLE], out[O_SECONDS] = math.atan2(across, along), between_s
        out[O_ACCEL] = math.sqrt(math.sqrt(along * along + across * across)) / between_s
        per_rad = STANDARD_GRAVITY_M_S2 * between_s
        out[O_TILT], out[O_TILT + 1] = (ge - fe) / per_rad, -(gn - fn) / per_rad
        out[O_CHANGE] = math.sqrt(gn * gn + ge * ge) / between_s
        s[S_SINCE_FIX] = 0.0
        out[O_COURSE], out[O_SPEED] = wrap(math.atan2(east, north) - heading), math.sqrt(north * north + east * east)
    s[S_HAS_FIX], s[S_T_FIX] = 1.0, t_ns
    s[S_FIX_FELT], s[S_FIX_FELT + 1], s[S_FIX_VEL], s[S_FIX_VEL + 1] = felt_n, felt_e, north, east
    return ready
