"""The enumerations of `types` as plain integers, because compiled code takes globals of type int as constants."""

from __future__ import annotations

from typing import Final

from server.nav.types import Aid, AidStatus, Kind, LaneStatus, VehicleClass

IMU: Final = int(Kind.IMU)
MAG: Final = int(Kind.MAG)
BARO: Final = int(Kind.BARO)
GNSS: Final = int(Kind.GNSS)
AIRSPEED: Final = int(Kind.AIRSPEED)
REFERENCE: Final = int(Kind.REFERENCE)
ONBOARD: Final = int(Kind.ONBOARD)
DMP: Final = int(Kind.DMP)

FUSED: Final = int(AidStatus.FUSED)
REFUSED_GATE: Final = int(AidStatus.REFUSED_GATE)
REFUSED_REPEATED: Final = int(AidStatus.REFUSED_REPEATED)
REFUSED_STALE: Final = int(AidStatus.REFUSED_STALE)
REFUSED_NO_FIX: Final = int(AidStatus.REFUSED_NO_FIX)
REFUSED_RANGE: Final = int(AidStatus.REFUSED_RANGE)
REFUSED_DISABLED: Final = int(AidStatus.REFUSED_DISABLED)
REFUSED_WITHHELD: Final = int(AidStatus.REFUSED_WITHHELD)
REFUSED_NOT_READY: Final = int(AidStatus.REFUSED_NOT_READY)
REFUSED_DISTURBED: Final = int(AidStatus.REFUSED_DISTURBED)
REFUSED_MOVING: Final = int(AidStatus.REFUSED_MOVING)
REFUSED_ORDER: Final = int(AidStatus.REFUSED_ORDER)

GNSS_POSITION: Final = int(Aid.GNSS_POSITION)
GNSS_VELOCITY: Final = int(Aid.GNSS_VELOCITY)
BARO_HEIGHT: Final = int(Aid.BARO_HEIGHT)
MAG_FIELD: Final = int(Aid.MAG_FIELD)
ZERO_VELOCITY: Final = int(Aid.ZERO_VELOCITY)
ZERO_RATE: Final = int(Aid.ZERO_RATE)
GRAVITY: Final = int(Aid.GRAVITY)
AIRSPEED_AID: Final = int(Aid.AIRSPEED)
SIDESLIP: Final = int(Aid.SIDESLIP)
WHEELS: Final = int(Aid.WHEELS)
YAW: Final = int(Aid.YAW)
DRAG_AID: Final = int(Aid.DRAG)

ALIGNING: Final = int(LaneStatus.ALIGNING)
ATTITUDE: Final = int(LaneStatus.ATTITUDE)
NAVIGATING: Final = int(LaneStatus.NAVIGATING)
DEAD_RECKONING: Final = int(LaneStatus.DEAD_RECKONING)
FAILED: Final = int(LaneStatus.FAILED)

MULTIROTOR: Final = int(VehicleClass.MULTIROTOR)
FIXED_WING: Final = int(VehicleClass.FIXED_WING)
CAR: Final = int(VehicleClass.CAR)
HAND_HELD: Final = int(VehicleClass.HAND_HELD)
