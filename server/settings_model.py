"""Every setting once, with unit, default, limits and description; `settings` reads their values.

Only `settings` imports this.
"""

from __future__ import annotations

import ipaddress
import json
import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr, field_validator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from server.chain_values import chain_values
from server.lane_values import lane_values
from server.nav.constants import NAV_RATE_MAX_HZ, NAV_RATE_MIN_HZ
from server.nav.types import EngineSettings, VehicleClass

VEHICLES = {
    "auto": VehicleClass.UNKNOWN,
    "multirotor": VehicleClass.MULTIROTOR,
    "fixed_wing": VehicleClass.FIXED_WING,
    "car": VehicleClass.CAR,
    "hand_held": VehicleClass.HAND_HELD,
}
ListOfText = Annotated[tuple[str, ...], NoDecode]
Delay = Annotated[float, Field(ge=-1.0, le=10.0)]


def default_data_dir() -> Path:
    """Where recordings and calibrations go when nothing is said: $XDG_DATA_HOME/navdeck or ~/.local/share/navdeck."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "navdeck"


class Settings(BaseSettings):
    """What navdeck may be told. None (absent) means: found out by itself."""

    model_config = SettingsConfigDict(
        env_prefix="NAVDECK_", env_ignore_empty=True, extra="forbid", frozen=True, allow_inf_nan=False
    )

    host: str = Field("127.0.0.1", min_length=1, description="address to listen at; 0.0.0.0 = all, needs a token")
    port: int = Field(8080, ge=0, le=65535, description="TCP port of page, API and 3D view; 0 = any free one")
    links: ListOfText = Field(
        ("sim:",), description="links to boards: serial:///dev/ttyACM0?baud=921600, auto, sim:, …"
    )
    token: SecretStr | None = Field(None, min_length=1, description="token of an operator")
    viewer_token: SecretStr | None = Field(None, min_length=1, description="token that only allows to look")
    insecure: bool = Field(False, description="listen beyond this machine without a token: anybody may operate")
    allowed_hosts: ListOfText = Field((), description="further names by which the page may be asked for; * = any")
    view3d: bool = Field(True, description="draw the 3D scene; off saves its memory on a headless board computer")
    data_dir: Path = Field(default_factory=default_data_dir, description="folder of recordings and calibrations")
    log_level: Literal["debug", "info", "warning", "error"] = Field("info", description="least severity that is logged")
    history_s: float = Field(600.0, ge=10.0, le=3600.0, description="past that a page which opens late gets, s")
    talk: bool = Field(True, description="send to the board: heartbeat, stream requests, time sync; off = only listen")
    mavlink_system: int | None = Field(None, ge=1, le=255, description="MAVLink system to follow; absent = the first")
    mavlink_component: int | None = Field(None, ge=0, le=255, description="MAVLink component; absent = its autopilot")
    nav_rate_hz: float = Field(
        50.0, ge=NAV_RATE_MIN_HZ, le=NAV_RATE_MAX_HZ, description="navigation steps a second, up to the IMU's rate"
    )
    lanes: ListOfText = Field(
        ("ins_ekf", "onboard", "reference"),
        min_length=1,
        description="estimators to run; the first is the main one; all = every one",
    )
    lane_parameters: ListOfText = Field(
        (), description="numbers of estimators that are not at their default, as LANE.PARAMETER=VALUE"
    )
    preprocess: ListOfText = Field(
        (),
        description="units, mounting and filters of sensors, as SENSOR.PARAMETER=VALUE:"
        " gyro.butterworth_hz=40, imu.lowpass_hz=60, baro.window_samples=3, board.mounting=roll180",
    )
    vehicle: Literal["auto", "multirotor", "fixed_wing", "car", "hand_held"] = Field(
        "auto", description="class of vehicle; auto = what the board says"
    )
    site_lat_deg: float | None = Field(
        None, ge=-90, le=90, description="latitude of the local origin; absent = first fix"
    )
    site_lon_deg: float | None = Field(None, ge=-180, le=180, description="longitude of the local origin")
    site_alt_m: float | None = Field(None, ge=-1000, le=100_000, description="height of the local origin")
    decimal_year: float | None = Field(
        None, ge=2020, le=2035, description="date of the magnetic model; absent = board's"
    )
    imu_delay_s: Delay | None = Field(None, description="age of an IMU sample at its stamp, s; absent = profile")
    mag_delay_s: Delay | None = Field(None, description="the same of the magnetometer, s")
    gnss_delay_s: Delay | None = Field(None, description="the same of GNSS, s")
    baro_delay_s: Delay | None = Field(None, description="the same of the barometer, s")
    lever_arm_b_m: Annotated[tuple[float, float, float], NoDecode] = Field(
        (0.0, 0.0, 0.0), description="from the IMU to the GNSS antenna, m forward, right, down"
    )
    gyro_noise_rad_s_rthz: float | None = Field(None, gt=0, le=1, description="gyro noise density; absent = by vehicle")
    accel_noise_m_s2_rthz: float | None = Field(None, gt=0, le=10, description="accelerometer noise density")
    gyro_bias_walk_rad_s2_rthz: float | None = Field(None, gt=0, le=1, description="gyro bias random walk")
    accel_bias_walk_m_s3_rthz: float | None = Field(None, gt=0, le=1, description="accelerometer bias random walk")
    use_gnss: bool = Field(True, description="let GNSS correct the state")
    use_baro: bool = Field(True, description="let the barometer correct the state")
    use_mag: bool = Field(True, description="let the magnetometer correct the state")
    use_airspeed: bool = Field(True, description="let the airspeed correct the state")

    @field_validator("links", "allowed_hosts", "lanes", "lane_parameters", "preprocess", "lever_arm_b_m", mode="before")
    @classmethod
    def _split(cls, value: object) -> object:
        """Take a list, a JSON list, or text with commas, as a variable of the environment holds it."""
        if not isinstance(value, str):
            return value
        if value.lstrip().startswith("["):
            return json.loads(value)
        return tuple(part.strip() for part in value.split(",") if part.strip())

    @field_validator("lanes")
    @classmethod
    def _every_lane(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        """Take "all" for every estimator there is; other names are checked when the engine is made."""
        if value != ("all",):
            return value
        from server.nav.lanes.registry import LANES  # loads every kernel

        return LANES

    @field_validator("lane_parameters")
    @classmethod
    def _readable(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        """Refuse what is not LANE.PARAMETER=VALUE; names and limits are checked when the engine is made."""
        lane_values(value)
        return value

    @field_validator("preprocess")
    @classmethod
    def _readable_chain(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        """Refuse what is not SENSOR.PARAMETER=VALUE; names and limits are checked when the engine is made."""
        chain_values(value)
        return value

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Sources in order of precedence; `load_settings` merges them itself, so that it knows who said what."""
        return (init_settings,)

    def engine_settings(self) -> EngineSettings:
        """Return the part that the numeric core takes."""
        names = (set(EngineSettings.__dataclass_fields__) & set(type(self).model_fields)) - {
            "vehicle",
            "lane_parameters",
        }
        known = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        values = lane_values(self.lane_parameters)
        chain = chain_values(self.preprocess)
        return EngineSettings(vehicle=VEHICLES[self.vehicle], lane_parameters=values, chain=chain, **known)

    @property
    def has_token(self) -> bool:
        """True when any token is configured, so that everybody has to show one."""
        return self.token is not None or self.viewer_token is not None

    @property
    def is_loopback(self) -> bool:
        """True when only this machine can reach the service."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False
