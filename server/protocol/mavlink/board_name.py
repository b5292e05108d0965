"""A board's name for people, from its heartbeat."""

from __future__ import annotations

from functools import lru_cache

AUTOPILOTS = {3: "ArduPilot", 12: "PX4", 0: "Generic autopilot", 4: "OpenPilot", 13: "SmartAP", 14: "AirRails"}


@lru_cache(maxsize=64)
def board_name(autopilot: int, vehicle: int, system: int) -> str:
    """Return e.g. "ArduPilot quadrotor, system 1"; autopilot -1 = no heartbeat yet."""
    if autopilot < 0:
        return f"board without heartbeat, system {system}"
    from pymavlink.dialects.v20 import all as dialect

    maker = AUTOPILOTS.get(autopilot) or _words(dialect, "MAV_AUTOPILOT", autopilot)
    return f"{maker} {_words(dialect, 'MAV_TYPE', vehicle)}, system {system}"


def _words(dialect: object, enum: str, value: int) -> str:
    entry = dialect.enums[enum].get(value)  # type: ignore[attr-defined]
    return str(entry.name).removeprefix(f"{enum}_").replace("_", " ").lower() if entry else f"type {value}"
