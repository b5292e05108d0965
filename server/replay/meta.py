"""`meta.toml` of a sensor folder: what the person knows of vehicle, site, receiver and sensors."""

from __future__ import annotations

import calendar
import datetime as dt
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, ValidationError, model_validator

from server.nav.types import VehicleClass
from server.replay.errors import ReplayError, nearest

VehicleName = Literal["multirotor", "fixed_wing", "car", "hand_held"]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]  # strict: neither text nor true is a number
Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]


def _date(value: object) -> object:
    """Return the date of a TOML date or an ISO 8601 text; a bare number is not one."""
    if value is None or isinstance(value, dt.date):
        return value
    try:
        moment = dt.datetime.fromisoformat(str(value))
    except ValueError:
        moment = None
    if moment is None or not isinstance(value, str):
        raise ValueError(f"{value!r} is not a date: write date = 2026-11-22")
    return moment if len(value) > 10 else moment.date()


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class VehicleIn(_Part):
    """`[vehicle]`: chooses the set of default parameters."""

    class_: VehicleName | None = Field(
        default=None, alias="class", description="class of vehicle; absent = general defaults"
    )


class SiteIn(_Part):
    """`[site]`: origin of the local frame and date of the magnetic model."""

    lat_deg: float | None = Field(
        default=None, strict=True, ge=-90.0, le=90.0, description="geodetic latitude; absent = the first 3-D fix"
    )
    lon_deg: float | None = Field(
        default=None, strict=True, ge=-180.0, le=360.0, description="longitude; goes with lat_deg"
    )
    alt_m: Finite | None = Field(default=None, description="height in the input's own datum")
    date: Annotated[dt.date | dt.datetime | None, BeforeValidator(_date)] = Field(
        default=None, description="date of the magnetic model, ISO 8601; absent = WMM's own epoch, reported"
    )

    @model_validator(mode="after")
    def _place_is_whole(self) -> SiteIn:
        if (self.lat_deg is None) != (self.lon_deg is None):
            raise ValueError("lat_deg and lon_deg go together: give both or neither")
        return self


class GnssIn(_Part):
    """`[gnss]`: the receiver."""

    delay_s: float | None = Field(
        default=None,
        strict=True,
        ge=-10.0,
        le=10.0,
        description="a row is valid at t_ns - delay_s; absent = found from the innovations",
    )
    lever_arm_b_m: tuple[Finite, Finite, Finite] = Field(
        default=(0.0, 0.0, 0.0), description="from the IMU to the antenna, body FRD"
    )


class ImuIn(_Part):
    """`[imu]`: noise densities; absent = the vehicle class's default."""

    gyro_noise_rad_s_rthz: Positive | None = Field(default=None, description="gyro white noise, rad/s/√Hz")
    accel_noise_m_s2_rthz: Positive | None = Field(default=None, description="accelerometer white noise, m/s²/√Hz")
    gyro_bias_walk_rad_s2_rthz: Positive | None = Field(default=None, description="gyro bias random walk, rad/s²/√Hz")
    accel_bias_walk_m_s3_rthz: Positive | None = Field(
        default=None, description="accelerometer bias random walk, m/s³/√Hz"
    )


class AidsIn(_Part):
    """`[aids]`: which sensors may correct the estimate."""

    gnss: StrictBool = Field(default=True, description="fuse GNSS")
    baro: StrictBool = Field(default=True, description="fuse barometric height")
    mag: StrictBool = Field(default=True, description="fuse the magnetic field")
    airspeed: StrictBool = Field(default=True, description="fuse airspeed")


class MetaIn(_Part):
    """`meta.toml`; every table and key is optional."""

    vehicle: VehicleIn = VehicleIn()
    site: SiteIn = SiteIn()
    gnss: GnssIn = GnssIn()
    imu: ImuIn = ImuIn()
    aids: AidsIn = AidsIn()

    def overrides(self) -> dict[str, Any]:
        """Return the fields of EngineSettings this file sets; a folder's delays are 0 unless it says otherwise."""
        found: dict[str, Any] = {"lever_arm_b_m": self.gnss.lever_arm_b_m}
        if self.gnss.delay_s is not None:
            found["gnss_delay_s"] = self.gnss.delay_s
        found |= {f"use_{name}": value for name, value in self.aids.model_dump().items()}
        found |= {name: value for name, value in self.imu.model_dump().items() if value is not None}
        site = self.site.model_dump(exclude={"date"})
        found |= {f"site_{name}": value for name, value in site.items() if value is not None}
        if self.vehicle.class_ is not None:
            found["vehicle"] = VehicleClass[self.vehicle.class_.upper()]
        if self.site.date is not None:
            found["decimal_year"] = decimal_year(self.site.date)
        return found


def decimal_year(date: dt.date) -> float:
    """Return the date as a decimal year: 2026-01-01 is 2026.0."""
    day = date.timetuple().tm_yday - 1
    if isinstance(date, dt.datetime):
        day_s = date.hour * 3600 + date.minute * 60 + date.second
        return date.year + (day + day_s / 86400) / (366 if calendar.isleap(date.year) else 365)
    return date.year + day / (366 if calendar.isleap(date.year) else 365)


def read_meta(path: Path) -> MetaIn:
    """Return what the file says; a file that does not exist says nothing.

    Raises:
        ReplayError: not TOML, an unknown key, or a value out of range.
    """
    if not path.is_file():
        return MetaIn()
    try:
        return MetaIn.model_validate(tomllib.loads(path.read_text(encoding="utf-8-sig")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ReplayError(f"{path} is not valid TOML: {error}. Text values need quotes.") from error
    except ValidationError as error:
        raise ReplayError(" ".join(dict.fromkeys(_sentence(path, part) for part in error.errors()))) from error


def _sentence(path: Path, part: Any) -> str:  # noqa: ANN401  (pydantic's ErrorDetails)
    place = [str(step) for step in part["loc"]]
    key, table = (place[1] if len(place) > 1 else place[0]), place[0]
    if part["type"] == "extra_forbidden":
        known = _known(table) if len(place) > 1 else list(MetaIn.model_fields)
        where = f"[{table}] {key}" if len(place) > 1 else f"[{key}]"
        return f"{path}: {where} is not known{nearest(key, known)}. Known here: {', '.join(known)}."
    shown = f"[{table}] {key}" if len(place) > 1 else f"[{table}]"
    message = str(part["msg"]).removeprefix("Value error, ")
    given = "" if part["type"] == "value_error" else f" = {part['input']!r}"
    return f"{path}: {shown}{given} is refused: {message}."


def _known(table: str) -> list[str]:
    part = MetaIn.model_fields[table].annotation
    return [field.alias or name for name, field in part.model_fields.items()] if isinstance(part, type) else []
