"""Every setting once, with unit, default and description; the sole reader of the environment and the settings file.

Flags win over NAVDECK_* variables, those over the file, that over the defaults. Only `cli` and `app` import this.
"""

from __future__ import annotations

import difflib
import ipaddress
import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, SecretStr, ValidationError, field_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails
from pydantic_settings import (
    BaseSettings,
    EnvSettingsSource,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from server.nav.types import EngineSettings, VehicleClass
from server.wire_service import SettingOut, SettingsOut

VEHICLES = {
    "auto": VehicleClass.UNKNOWN,
    "multirotor": VehicleClass.MULTIROTOR,
    "fixed_wing": VehicleClass.FIXED_WING,
    "car": VehicleClass.CAR,
    "hand_held": VehicleClass.HAND_HELD,
}
UNITS: Final = (
    ("_rad_s_rthz", "rad/s/√Hz"),
    ("_m_s2_rthz", "m/s²/√Hz"),
    ("_rad_s2_rthz", "rad/s²/√Hz"),
    ("_m_s3_rthz", "m/s³/√Hz"),
    ("_hz", "Hz"),
    ("_deg", "°"),
    ("_m", "m"),
    ("_s", "s"),
)
Source = Literal["default", "file", "environment", "flag"]
ListOfText = Annotated[tuple[str, ...], NoDecode]
Delay = Annotated[float, Field(ge=-1.0, le=10.0)]
FILE_NAMES = (Path("navdeck.toml"), Path("~/.config/navdeck/navdeck.toml"))
PREFIX = "NAVDECK_"
OTHER_VARIABLES = {"NAVDECK_CHROMIUM"}  # of the tests, not of the service


def default_data_dir() -> Path:
    """Where recordings and calibrations go when nothing is said: $XDG_DATA_HOME/navdeck or ~/.local/share/navdeck."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "navdeck"


class SettingsError(ValueError):
    """A setting that cannot be; the text names the value, the limit and the remedy."""


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
    nav_rate_hz: float = Field(50.0, ge=1.0, le=1000.0, description="navigation steps a second, up to the IMU's rate")
    lanes: ListOfText = Field(("ins_ekf", "onboard", "reference"), min_length=1, description="estimators to run")
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

    @field_validator("links", "allowed_hosts", "lanes", "lever_arm_b_m", mode="before")
    @classmethod
    def _split(cls, value: object) -> object:
        """Take a list, a JSON list, or text with commas, as a variable of the environment holds it."""
        if not isinstance(value, str):
            return value
        if value.lstrip().startswith("["):
            return json.loads(value)
        return tuple(part.strip() for part in value.split(",") if part.strip())

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
        names = (set(EngineSettings.__dataclass_fields__) & set(type(self).model_fields)) - {"vehicle"}
        known = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return EngineSettings(vehicle=VEHICLES[self.vehicle], **known)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedSettings:
    """The settings, who said each value, and what was said in vain."""

    settings: Settings
    sources: dict[str, Source]
    file: Path | None
    unknown_variables: tuple[str, ...] = ()


def load_settings(flags: dict[str, Any] | None = None, config: Path | None = None) -> LoadedSettings:
    """Merge flags, environment, file and defaults into one validated whole.

    Args:
        flags: values by setting name, as given on the command line; None values count as not given.
        config: settings file; None = the first of `FILE_NAMES` that exists.

    Raises:
        SettingsError: a value is unknown or outside its limits; the text names value, limit and remedy.
    """
    file = config if config is not None else next((p for p in map(Path.expanduser, FILE_NAMES) if p.is_file()), None)
    from_file = _read_file(file) if file is not None else {}
    from_env = EnvSettingsSource(Settings)()
    from_flags = {name: value for name, value in (flags or {}).items() if value is not None}
    sources: dict[str, Source] = dict.fromkeys(Settings.model_fields, "default")
    for source, values in (("file", from_file), ("environment", from_env), ("flag", from_flags)):
        sources.update(dict.fromkeys(values, source))  # type: ignore[arg-type]  # the literals above are Sources
    try:
        settings = Settings(**{**from_file, **from_env, **from_flags})
    except ValidationError as error:
        raise SettingsError("\n".join(_sentence(e, sources, file) for e in error.errors())) from None
    known = {PREFIX + name.upper() for name in Settings.model_fields} | OTHER_VARIABLES
    unknown = tuple(sorted(name for name in os.environ if name.startswith(PREFIX) and name not in known))
    return LoadedSettings(settings=settings, sources=sources, file=file, unknown_variables=unknown)


def _read_file(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except OSError as error:
        remedy = "Remedy: name a file that exists and that you may read with --config, or leave --config out."
        raise SettingsError(f"settings file {file}: {error.strerror}. {remedy}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"settings file {file} is not TOML: {error}. Remedy: write e.g. port = 8080.") from None


def _sentence(error: ErrorDetails, sources: dict[str, Source], file: Path | None) -> str:
    """Say which value, from where, breaks which limit, and what to do."""
    name = str(error["loc"][0]) if error["loc"] else "settings"
    if error["type"] == "extra_forbidden":
        near = difflib.get_close_matches(name, Settings.model_fields, n=1)
        hint = f"did you mean {near[0]}?" if near else f"one of: {', '.join(Settings.model_fields)}."
        return f"{name}: there is no such setting in {file or 'the flags'}. Remedy: {hint}"
    where = {"file": f"in {file}", "environment": f"in {PREFIX}{name.upper()}", "flag": "on the command line"}
    value = "(hidden)" if "token" in name else repr(error["input"])
    limit = error["msg"].removeprefix("Value error, ")
    return f"{name} = {value} {where.get(sources.get(name, ''), '')}: {limit}. Remedy: {_remedy(name)}"


def _remedy(name: str) -> str:
    flag = flag_of(name)
    field = Settings.model_fields[name]
    return f"give another value with {flag}, {PREFIX}{name.upper()} or in navdeck.toml ({field.description})."


def flag_of(name: str) -> str:
    """Return the command line flag of a setting; lists are given one value a flag, so theirs is singular."""
    singular = {"links": "link", "allowed_hosts": "allowed-host", "lanes": "lane"}
    return "--" + singular.get(name, name).replace("_", "-")


def settings_out(loaded: LoadedSettings) -> SettingsOut:
    """Return every setting for people; of a secret only whether it is set."""
    fields = Settings.model_fields.items()
    rows = tuple(_setting_out(loaded, name, field) for name, field in fields)
    return SettingsOut(settings=rows, file=str(loaded.file or ""))


def _setting_out(loaded: LoadedSettings, name: str, field: FieldInfo) -> SettingOut:
    return SettingOut(
        name=name,
        value=_plain(getattr(loaded.settings, name)),
        default=_plain(default_of(field)),
        unit=unit_of(name),
        description=field.description or "",
        source=loaded.sources.get(name, "default"),
    )


def default_of(field: FieldInfo) -> object:
    """Return what a setting is when nobody says anything."""
    return field.get_default(call_default_factory=True, validated_data={})


def unit_of(name: str) -> str:
    """Return the unit in a setting's name; "" when it has none."""
    return next((unit for suffix, unit in UNITS if name.endswith(suffix)), "")


def default_text(name: str) -> str:
    """Return the default with its unit, as the command line's help shows it."""
    default, unit = default_of(Settings.model_fields[name]), unit_of(name)
    texts = {None: "absent", True: "on", False: "off", (): "none"}
    if default is None or isinstance(default, bool) or default == ():
        return f"{texts[default]}, {unit}" if unit else texts[default]
    if isinstance(default, tuple):
        return f"{', '.join(f'{part:g}' if isinstance(part, float) else part for part in default)} {unit}".strip()
    return f"{default:g} {unit}" if isinstance(default, float) else str(default)


def _plain(value: object) -> object:
    if isinstance(value, SecretStr):
        return "(set)"
    return str(value) if isinstance(value, Path) else value
