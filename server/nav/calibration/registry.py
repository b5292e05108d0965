"""Which collector does which calibration; the one place that knows them all."""

from __future__ import annotations

from importlib import import_module
from typing import Final, cast

from server.nav.calibration.types import CalKind, Collector, Options

_CLASSES: Final = {
    CalKind.GYRO_BIAS: "gyro_bias.GyroBias",
    CalKind.GYRO_SCALE: "gyro_scale.GyroScale",
    CalKind.ACCEL_SIX_POSITION: "six_position.SixPosition",
    CalKind.ACCEL_MULTI_POSE: "multi_pose.MultiPose",
    CalKind.LEVEL: "level.Level",
    CalKind.MAG_ELLIPSOID: "mag_ellipsoid.MagEllipsoid",
    CalKind.MAG_FIXED_HEADING: "fixed_heading.MagFixedHeading",
    CalKind.MAG_IN_FLIGHT: "in_flight.MagInFlight",
    CalKind.AIRSPEED_ZERO: "zero.AirspeedZero",
    CalKind.BARO_REFERENCE: "zero.BaroReference",
}


def collector_for(kind: CalKind, options: Options) -> Collector:
    """Return a collector that has seen nothing; its module is loaded when it is first asked for.

    Raises:
        ValueError: an option that this kind needs is missing or impossible; the text names it, its limit, the remedy.
    """
    module, _, name = _CLASSES[kind].partition(".")
    made = getattr(import_module(f"server.nav.calibration.{module}"), name)(options)
    return cast("Collector", made)
