"""Columns of the arrays that the compiled filter shares: navigation steps, measurements, parameters, memory.

Flat float64 arrays with named columns cost one pointer in a call; a record would cost microseconds.
"""

from __future__ import annotations

from typing import Final

# One navigation step as the preprocessing emits it. Times are ns since the engine's first sample, as float64 (exact
# for 104 days). Rotation and velocity increments keep coning and sculling.
U_T: Final = 0  # end of the step, stamp of its last IMU sample, ns
U_DT: Final = 1  # s
U_DTHETA: Final = 2  # (3) rotation vector over the step, body at its start, rad
U_DVEL: Final = 5  # (3) specific force integrated in the body frame at the start of the step, m/s
U_GYRO: Final = 8  # (3) last sample, rad/s
U_ACCEL: Final = 11  # (3) last sample, m/s²
U_GYRO_MEAN: Final = 14  # (3) rad/s
U_ACCEL_MEAN: Final = 17  # (3) m/s²
U_COUNT: Final = 20  # samples in the step
U_VIBRATION: Final = 21  # RMS of high-passed specific force, m/s²
U_GAP_S: Final = 22  # longest hole between samples that this step bridges, s
U_TEMPERATURE: Final = 23  # °C, NaN unknown
U_SIZE: Final = 24

# One measurement on its way to the lanes.
M_KIND: Final = 0  # value of types.Kind
M_T: Final = 1  # stamp, ns since the first sample
M_STEP: Final = 2  # index, in this call, of the step at whose end it is available
M_STATUS: Final = 3  # AidStatus found by the preprocessing; FUSED = believed so far
M_DATA: Final = 4  # (14) columns of types.SAMPLE_COLUMNS, field scaled to gauss, baro column 1 always a height
M_SIZE: Final = 18

# A measurement kept in the filter's history.
H_AID: Final = 0
H_T: Final = 1  # time of validity on the IMU's clock, ns
H_STATUS: Final = 2  # −1 undecided, then AidStatus, or RESET
H_DATA: Final = 3  # (9) observation
H_ACC: Final = 12  # (3) standard deviations as reported or assumed
H_VAR: Final = 15  # (3) variances decided on at first use, kept for every re-run
H_FLOOR: Final = 18  # least standard deviation the innovations may bring it down to
H_WANDER: Final = 19  # σ of the slow error of this receiver's fixes, per horizontal axis, m; 0 = none
H_WANDER_D: Final = 20  # and down
H_SIZE: Final = 21
UNDECIDED: Final = -1.0
RESET: Final = 100.0  # this measurement set velocity and position instead of correcting them

# Parameters.
PAR_GYRO_NOISE: Final = 0  # rad/s/√Hz
PAR_ACCEL_NOISE: Final = 1  # m/s²/√Hz
PAR_GYRO_WALK: Final = 2  # rad/s²/√Hz
PAR_ACCEL_WALK: Final = 3  # m/s³/√Hz
PAR_GATE: Final = 4  # standard deviations
PAR_MAG_NOISE: Final = 5  # gauss
PAR_DECLINATION_SIGMA: Final = 6  # rad
PAR_BARO_NOISE: Final = 7  # m
PAR_GNSS_CORRELATION: Final = 8  # variance factor for receivers' correlated velocity errors
PAR_LEVER: Final = 9  # (3) body m
PAR_IMU_DELAY: Final = 12  # s
PAR_MAG_DELAY: Final = 13
PAR_GNSS_DELAY: Final = 14
PAR_BARO_DELAY: Final = 15
PAR_ACCEL_BIAS_SIGMA: Final = 16  # m/s²
PAR_BARO_DRIFT: Final = 17  # m/√s
PAR_VEHICLE: Final = 18
PAR_GRAVITY_NOISE: Final = 19  # m/s²
PAR_FIELD_WALK: Final = 20  # gauss/√s
PAR_MAG_BIAS_SIGMA: Final = 21  # gauss
PAR_MAG_BIAS_WALK: Final = 22  # gauss/√s
PAR_WIND_SIGMA: Final = 23  # m/s
PAR_WIND_WALK: Final = 24  # m/s/√s
PAR_FIELD_SIGMA: Final = 25  # error of the model's strength, as a share of it
PAR_MAG_TIMING: Final = 26  # s, how well the magnetometer's delay is known
PAR_GNSS_WANDER: Final = 27  # m per horizontal axis; NaN: from the reported accuracy
PAR_GNSS_WANDER_TAU: Final = 28  # s
PAR_GNSS_JITTER: Final = 29  # m per horizontal axis; NaN: learned from the innovations
PAR_GNSS_JITTER_TAU: Final = 30  # s; 0 = white
PAR_GNSS_SPEED: Final = 31  # m/s per axis; NaN: learned from the innovations
PAR_GNSS_SPEED_TAU: Final = 32  # s, of a velocity error that is told
PAR_ZERO_RATE: Final = 33  # rad/s
PAR_ZERO_VELOCITY: Final = 34  # m/s
PAR_GYRO_SCALE: Final = 35  # σ of the scale errors, a share of the rate; 0 with no cross-axis ones = no such states
PAR_GYRO_CROSS: Final = 36  # σ of the cross-axis errors, likewise
PAR_VIBRATION_BANDWIDTH: Final = 37  # Hz over which measured vibration is white
PAR_DRAG: Final = 38  # m/s², what drag leaves unexplained of the specific force across; 0 = drag is left out
PAR_DRAG_K: Final = 39  # 1/s
PAR_DRAG_K_SIGMA: Final = 40
PAR_DRAG_WALK: Final = 41  # 1/s/√s
PAR_GYRO_PER_K: Final = 42  # rad/s/K, σ of what the temperature does to a bias
PAR_ACCEL_PER_K: Final = 43  # m/s²/K
PAR_SIZE: Final = 44

NEVER_NS: Final = -1e18
"""A time before every other."""

# Memory that is not rolled back: integers …
C_MODE: Final = 0  # LaneStatus
C_HEAD: Final = 1  # slots pushed so far
C_VALID: Final = 2  # slots that can be re-run from (since the last alignment or frame change)
C_AIDS: Final = 3  # aid rows written in this call
C_HAS_SITE: Final = 4
C_HAS_FIELD: Final = 5
C_HAS_HEADING: Final = 6
C_POSITIONED: Final = 7  # velocity and position have been set from GNSS
C_MAG_SEEN: Final = 8
C_BARO_SEEN: Final = 9
C_STILL_STEPS: Final = 10
C_EVENTS: Final = 11
C_ALIGN_STEPS: Final = 12
C_REFUSED_RUN: Final = 13  # GNSS fixes refused in a row
C_STEPS: Final = 14
C_OVERFLOW: Final = 15
C_ALIGNED_BEFORE: Final = 16
C_BANK_HEADING: Final = 17  # the heading was set from the yaw bank
C_DELAYS_TOLD: Final = 18
C_SIZE: Final = 19

# … and numbers.
A_DECLINATION: Final = 0  # rad
A_FIELD_H: Final = 1  # gauss
A_FIELD_D: Final = 2  # gauss, down
A_T_GNSS: Final = 3  # validity of the last fused GNSS, ns
A_GNSS_INTERVAL: Final = 4  # s, mean
A_T_GNSS_SEEN: Final = 5
A_T_MAG: Final = 6
A_T_BARO: Final = 7
A_GNSS_WANDER_VAR_D: Final = 8  # of the slow error down, m²
A_GNSS_JITTER_VAR: Final = 9  # of the quick error per horizontal axis, m²
A_K_POS: Final = 10  # innovations' variance over the reported one: horizontal position
A_K_VEL: Final = 11
A_K_ALT: Final = 12
A_K_BARO: Final = 13
A_GYRO_MEAN: Final = 14  # (3)
A_GYRO_VAR: Final = 17  # (3)
A_ACCEL_MEAN: Final = 20  # (3)
A_ACCEL_VAR: Final = 23  # (3)
A_MAG_SUM: Final = 26  # (3) mean field in body over the alignment, and its weight
A_MAG_WEIGHT: Final = 29
A_SPEED_GNSS: Final = 30  # last GNSS ground speed, m/s
A_T_STILL: Final = 31  # last zero-velocity update, ns
A_T_ALIGN: Final = 32  # start of the present rest, ns
A_T_REFUSED: Final = 33  # first of the GNSS refusals in a row, ns
A_GRAVITY: Final = 34  # m/s², when no site is known
A_K_MAG: Final = 35
A_T_START: Final = 36
A_T_GRAVITY: Final = 37
A_GYRO_SUM: Final = 38  # (3) over the rest that alignment averages
A_ACCEL_SUM: Final = 41  # (3)
A_SITE: Final = 44  # (3) latitude rad, longitude rad, height m
A_T_RATE: Final = 47  # last zero-rate update, ns
A_GNSS_WANDER_VAR: Final = 48  # long-term variance of an ordinary receiver's slow error, m² per horizontal axis
A_T_RESET: Final = 49  # validity of the GNSS position that last set the state, ns
A_T_WHEELS: Final = 50  # last zero lateral velocity of a car, ns
A_T_ASTRAY: Final = 51  # since when the yaw bank contradicts the heading, ns; NEVER_NS when it does not
A_T_AIRSPEED: Final = 52
A_T_SIDESLIP: Final = 53
A_GNSS_JITTER_VAR_D: Final = 54
A_T_QUICK: Final = 55  # when the velocity last spoke against rest, ns
A_T_DRAG: Final = 56
A_K_DRAG: Final = 57
A_REST_HEIGHT: Final = 58  # where the vehicle last stood still, m; NaN = not known
A_TEMPERATURE: Final = 59  # °C, smoothed; NaN before the first
A_WARMING: Final = 60  # K/s
A_SIZE: Final = 61

# Scratch, so that nothing is allocated in a step.
W_U: Final = 0  # (18) input of the covariance prediction
W_OBS: Final = 87  # record of the measurement just handled
W_PRED: Final = 90
W_INNOV: Final = 93
W_VAR: Final = 96
W_RATIO: Final = 99
W_DIM: Final = 100  # error states that are active (`states`); not scratch: set when a block is switched on
W_LOG: Final = 101  # one more than the scalar updates logged behind W_SIZE (`update.log_scalar`); 0 = none are kept
W_DELAYS: Final = 102  # 1 while delays are estimated (`delays`); from here on kept between steps
W_LEARN: Final = 103  # 1 while a measurement is handled for the first time
W_D: Final = 104  # (3) −∂h/∂t of the scalar at hand, by delay
W_DELTA: Final = 107  # (3) estimate of what the delays in use lack, s
W_USED: Final = 110  # (3) found so far and in use, s
W_M: Final = 113  # (3, 3) covariance of the estimate, s²
W_SENS: Final = 122  # (3, SENS) sensitivities of the state error
DELAYS: Final = 3
SENS: Final = 40  # columns a sensitivity may take
W_H: Final = W_SENS + DELAYS * SENS  # (N) one row of H
W_PH: Final = W_H + SENS  # (N) P Hᵀ
W_DX: Final = W_PH + SENS  # (N) correction collected over one measurement
W_SIZE: Final = W_DX + SENS

# Events the kernel reports: code, time ns, size, second size.
E_ALIGNED: Final = 1  # heading sigma rad, tilt sigma rad
E_GNSS_RESET: Final = 2  # horizontal jump m, vertical jump m
E_GNSS_LOST: Final = 3
E_GNSS_BACK: Final = 4  # outage s, innovation m
E_YAW_RESET: Final = 5  # rad
E_FAILED: Final = 6
E_GAP: Final = 7  # s
E_HEADING: Final = 8  # rad
E_COURSE: Final = 9  # rad
E_BANK: Final = 10  # rad turned, sigma rad
E_DELAYS: Final = 11  # s, s
E_HANDOVER: Final = 12  # rad
E_SIZE: Final = 4

SLOT_MEASUREMENTS: Final = 16
"""Measurements one history slot can hold; more at the same step are refused as stale and counted."""

HANDLER: Final = (
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])"
)
"""Signature of everything that handles one measurement: (h, x, P, u, par, aux, ctl, work)."""
