"""The settings as they are: the sole reader of the environment and the file. `settings_model` says which there are.

Flags win over NAVDECK_* variables, those over the file, that over the defaults. Only `cli` and `app` import this.
"""

from __future__ import annotations

import difflib
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import SecretStr, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails
from pydantic_settings import EnvSettingsSource

from server.settings_model import Settings
from server.wire_service import SettingOut, SettingsOut

__all__ = [
    "LoadedSettings",
    "Settings",
    "SettingsError",
    "default_text",
    "flag_of",
    "load_settings",
    "settings_out",
]
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
FILE_NAMES = (Path("navdeck.toml"), Path("~/.config/navdeck/navdeck.toml"))
PREFIX = "NAVDECK_"
OTHER_VARIABLES = {"NAVDECK_CHROMIUM"}  # of the tests, not of the service


class SettingsError(ValueError):
    """A setting that cannot be; the text names the value, the limit and the remedy."""


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
    singular = {
        "links": "link",
        "allowed_hosts": "allowed-host",
        "lanes": "lane",
        "lane_parameters": "lane-parameter",
    }
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
