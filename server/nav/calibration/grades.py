"""What is good, fair and poor, and beyond which nothing is fitted: the documented limits of every kind here.

A grade is the worst of its parts. Good is what a sensor of this class can do with care, fair what still helps a
navigation filter, poor what should be repeated. Where a number comes from stands beside it.
"""

from __future__ import annotations

from typing import Final

from server.nav.calibration.types import CalKind, Grade

GOOD: Final[Grade] = "good"
FAIR: Final[Grade] = "fair"
POOR: Final[Grade] = "poor"

GRADE_LIMITS: Final[dict[CalKind, dict[str, tuple[float, float]]]] = {
    # 1σ of the mean: 0.0005 rad/s is 1.7 °/min, which a filter removes in seconds; 0.002 what it needs a minute for.
    # The bias itself: MEMS data sheets promise ±1 to ±5 °/s.
    CalKind.GYRO_BIAS: {"sigma_rad_s": (0.0005, 0.002), "bias_rad_s": (0.05, 0.09)},
    # 1σ of the scale: 0.5 % is 1.8° in a turn; a MEMS gyro's scale as delivered is good to 1 to 3 %.
    CalKind.GYRO_SCALE: {"sigma_share": (0.005, 0.015), "change_share": (0.05, 0.15)},
    # RMS of |a| − g over the poses [S1: < 0.1 m/s²]; placement is the RMS angle between poses and faces.
    CalKind.ACCEL_SIX_POSITION: {"residual_m_s2": (0.03, 0.1), "placement_deg": (1.5, 3.0)},
    # The same residual, and the worst 1σ of offset (of g) and matrix (of 1).
    CalKind.ACCEL_MULTI_POSE: {"residual_m_s2": (0.03, 0.1), "sigma_share": (0.002, 0.006)},
    # 1σ of roll and pitch, and how far the length at rest is from g (which tilts the result by offset / g).
    CalKind.LEVEL: {"sigma_rad": (0.001, 0.004), "length_m_s2": (0.1, 0.4)},
    # Scatter of half-second means at rest; 2 Pa are 0.6 m/s at 3 m/s and 0.05 m/s at 30 m/s.
    CalKind.AIRSPEED_ZERO: {"spread_pa": (2.0, 8.0), "bias_pa": (150.0, 400.0)},
    # Scatter of half-second means of the height.
    CalKind.BARO_REFERENCE: {"spread_m": (0.3, 1.0)},
}
"""Kind → what is judged → (good up to, fair up to)."""

# Refusals. Gyro.
GYRO_BIAS_MAX_RAD_S: Final = 0.175  # 10 °/s: MEMS data sheets end at ±10 °/s; a steady turn looks like bias
TURN_MISMATCH: Final = 0.2  # share by which the measured angle may differ from the whole turns
TURN_LEAST: Final = 0.5  # of a turn: below, the board hardly turned
TURN_PURE: Final = 0.85  # share of the whole rotation vector that must lie on the axis (32° off)
# Accelerometer.
GRAVITY_LOW: Final = 0.8  # length at rest, of g, in SI; offsets of 1 m/s² and scale errors of 10 % pass
GRAVITY_HIGH: Final = 1.25
FACE_TILT_RAD: Final = 0.349  # 20°: a pose further from its axis is not a face
RESIDUAL_MAX_M_S2: Final = 0.3  # three times S1's: the poses were not still, or the sensor is not linear
POSES_LEAST: Final = 9
POSES_REJECTED_MAX: Final = 0.25
AMPLIFICATION_MAX: Final = 25.0  # worst parameter error per length error of one pose; 9 well-spread poses have 2 to 8
CHECK_POSES: Final = 3
CHECK_LENGTH_M_S2: Final = 0.1  # S1: after calibration |a| − g stays below
# Level.
LEVEL_TILT_MAX_RAD: Final = 0.262  # 15°
CHECK_LEVEL_RAD: Final = 0.0175  # 1°
# Pressure.
AIRSPEED_SPREAD_MAX_PA: Final = 15.0  # 5 m/s of wind into the tube
AIRSPEED_BIAS_MAX_PA: Final = 1000.0  # a quarter of the MPXV7002DP's range [S0 §3.4]
BARO_SPREAD_MAX_M: Final = 2.0
BARO_LOW_PA: Final = 30000.0  # 9 km
BARO_HIGH_PA: Final = 110000.0  # below the Dead Sea
BARO_HEIGHT_MAX_M: Final = 9500.0
CHECK_AIRSPEED_PA: Final = 8.0
CHECK_BARO_M: Final = 1.0
CHECK_RATE_RAD_S: Final = 0.005
CHECK_TURN_SHARE: Final = 0.02  # of the angle of the turns


def grade(kind: CalKind, measured: dict[str, float]) -> Grade:
    """Return the worst grade of the measured numbers, named as in `GRADE_LIMITS`; NaN is poor."""
    worst = 0
    for name, value in measured.items():
        good, fair = GRADE_LIMITS[kind][name]
        worst = max(worst, 0 if value <= good else 1 if value <= fair else 2)
    return (GOOD, FAIR, POOR)[worst]
