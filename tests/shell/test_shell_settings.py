"""Settings: who wins, what is refused and how it is said, and that each is documented once."""

import math
from pathlib import Path

import pytest

from server.magnetic import wmm_field
from server.nav.constants import NAV_RATE_MAX_HZ, NAV_RATE_MIN_HZ
from server.nav.engine import NavEngine
from server.nav.lanes.registry import LANES
from server.nav.types import EngineSettings, VehicleClass
from server.settings import Settings, SettingsError, flag_of, load_settings


def test_flags_win_over_the_environment_and_that_over_the_file(monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "navdeck.toml").write_text('port = 1001\nnav_rate_hz = 101.0\nlog_level = "error"\n')
    monkeypatch.setenv("NAVDECK_PORT", "1002")
    monkeypatch.setenv("NAVDECK_NAV_RATE_HZ", "102")
    loaded = load_settings({"port": "1003"})
    settings, sources = loaded.settings, loaded.sources
    assert (settings.port, settings.nav_rate_hz, settings.log_level) == (1003, 102.0, "error")
    assert [sources[name] for name in ("port", "nav_rate_hz", "log_level", "host")] == [
        "flag",
        "environment",
        "file",
        "default",
    ]


def test_the_file_beside_is_read_before_the_one_at_home_and_a_named_one_before_both(tmp_path: Path) -> None:
    home = tmp_path / ".config" / "navdeck"
    home.mkdir(parents=True)
    (home / "navdeck.toml").write_text("port = 1")
    assert load_settings().settings.port == 1
    (tmp_path / "navdeck.toml").write_text("port = 2")
    assert load_settings().settings.port == 2
    (tmp_path / "named.toml").write_text("port = 3")
    assert load_settings(config=tmp_path / "named.toml").settings.port == 3


@pytest.mark.parametrize(
    ("name", "value", "limit"),
    [
        ("port", "65536", "less than or equal to 65535"),
        ("port", "x", "valid integer"),
        ("nav_rate_hz", "0", "greater than or equal to 1"),
        ("nav_rate_hz", "nan", "finite"),
        ("vehicle", "boat", "'multirotor'"),
        ("site_lat_deg", "91", "less than or equal to 90"),
        ("mavlink_system", "0", "greater than or equal to 1"),
        ("links", "[1", "Expecting"),
        ("lever_arm_b_m", "1,2", "required"),
        ("gyro_noise_rad_s_rthz", "0", "greater than 0"),
        ("nav_rate_hz", "2000.5", "less than or equal to 2000"),
        ("lane_parameters", "ins_ekf.x", "LANE.PARAMETER=VALUE"),
        ("lane_parameters", "x=1", "LANE.PARAMETER=VALUE"),
        ("lane_parameters", "ins_ekf.x=much", "not a finite number"),
        ("lane_parameters", "ins_ekf.x=nan", "not a finite number"),
    ],
)
def test_a_refused_value_is_named_with_its_limit_its_place_and_the_remedy(
    monkeypatch, name: str, value: str, limit: str
) -> None:
    monkeypatch.setenv(f"NAVDECK_{name.upper()}", value)
    with pytest.raises(SettingsError) as refusal:
        load_settings()
    text = str(refusal.value)
    assert text.startswith(f"{name} = ")
    assert value.split(",", maxsplit=1)[0] in text
    assert limit in text
    assert f"NAVDECK_{name.upper()}" in text
    assert f"Remedy: give another value with {flag_of(name)}" in text


def test_a_misspelt_name_in_the_file_is_refused_with_the_likely_one(tmp_path: Path) -> None:
    (tmp_path / "navdeck.toml").write_text("nav_rat_hz = 10")
    with pytest.raises(SettingsError, match="did you mean nav_rate_hz"):
        load_settings()


def test_a_misspelt_variable_is_reported(monkeypatch) -> None:
    monkeypatch.setenv("NAVDECK_PROT", "1")
    assert load_settings().unknown_variables == ("NAVDECK_PROT",)


@pytest.mark.parametrize("text", ["port = ", "\xff"])
def test_a_file_that_is_not_toml_is_said_to_be_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "navdeck.toml").write_bytes(text.encode("latin-1"))
    with pytest.raises(SettingsError, match=r"is not TOML.*Remedy"):
        load_settings()


def test_a_named_file_that_is_absent_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"No such file.*Remedy"):
        load_settings(config=tmp_path / "absent.toml")


def test_lists_come_as_toml_lists_as_json_and_with_commas(monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "navdeck.toml").write_text('links = ["a:", "b:"]')
    assert load_settings().settings.links == ("a:", "b:")
    monkeypatch.setenv("NAVDECK_LINKS", "c:, d:")
    assert load_settings().settings.links == ("c:", "d:")
    monkeypatch.setenv("NAVDECK_LINKS", '["e:,f:"]')
    assert load_settings().settings.links == ("e:,f:",)


def test_all_is_every_estimator_there_is() -> None:
    settings = load_settings({"lanes": ["all"]}).settings
    assert settings.lanes == LANES
    assert settings.engine_settings().lanes == LANES


def test_numbers_of_estimators_reach_the_engine_from_the_environment_the_file_and_flags(
    monkeypatch, tmp_path: Path
) -> None:
    (tmp_path / "navdeck.toml").write_text('lane_parameters = ["a.b=1", "c.d=-2e-3"]')
    want = {"a": {"b": 1.0}, "c": {"d": -2e-3}}
    assert load_settings().settings.engine_settings().lane_parameters == want
    monkeypatch.setenv("NAVDECK_LANE_PARAMETERS", "a.b=3, a.e_m=4")
    assert load_settings().settings.engine_settings().lane_parameters == {"a": {"b": 3.0, "e_m": 4.0}}
    flags = {"lane_parameters": ["a.b=5", "a.b=6"]}
    assert load_settings(flags).settings.engine_settings().lane_parameters == {"a": {"b": 6.0}}


def test_the_rate_of_steps_has_the_engines_own_limits() -> None:
    for rate_hz in (NAV_RATE_MIN_HZ, NAV_RATE_MAX_HZ):
        assert load_settings({"nav_rate_hz": rate_hz}).settings.nav_rate_hz == rate_hz
        NavEngine(EngineSettings(nav_rate_hz=rate_hz), wmm_field)
    for rate_hz in (0.999 * NAV_RATE_MIN_HZ, 1.001 * NAV_RATE_MAX_HZ):
        with pytest.raises(SettingsError):
            load_settings({"nav_rate_hz": rate_hz})
        with pytest.raises(ValueError, match="nav_rate_hz"):
            NavEngine(EngineSettings(nav_rate_hz=rate_hz), wmm_field)


def test_an_empty_variable_is_as_if_it_were_not_there(monkeypatch) -> None:
    monkeypatch.setenv("NAVDECK_VIEWER_TOKEN", "")
    monkeypatch.setenv("NAVDECK_PORT", "")
    settings = load_settings().settings
    assert (settings.viewer_token, settings.port, settings.has_token) == (None, 8080, False)


def test_a_token_is_never_printed(monkeypatch) -> None:
    monkeypatch.setenv("NAVDECK_TOKEN", "quiet-please")
    assert "quiet-please" not in repr(load_settings().settings)
    with pytest.raises(SettingsError) as refusal:
        load_settings({"token": ["quiet-please"]})
    assert "quiet-please" not in str(refusal.value)


def test_what_is_not_said_leaves_the_engine_its_defaults() -> None:
    """Every field of the engine's settings that can be set has the same default in both places."""
    ours, engines = load_settings().settings.engine_settings(), EngineSettings()
    for name in EngineSettings.__dataclass_fields__:
        mine, other = getattr(ours, name), getattr(engines, name)
        assert mine == other or (math.isnan(mine) and math.isnan(other)), name


def test_what_is_said_reaches_the_engine() -> None:
    flags = {"vehicle": "fixed_wing", "gnss_delay_s": "0.1", "use_mag": False, "lever_arm_b_m": "0,0,-0.2"}
    engine = load_settings(flags).settings.engine_settings()
    assert (engine.vehicle, engine.gnss_delay_s, engine.use_mag) == (VehicleClass.FIXED_WING, 0.1, False)
    assert engine.lever_arm_b_m == (0.0, 0.0, -0.2)


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.8.8.8", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.2", False),
        ("bench", False),
    ],
)
def test_loopback_is_what_only_this_machine_reaches(host: str, loopback: bool) -> None:
    assert load_settings({"host": host}).settings.is_loopback is loopback


def test_every_setting_is_described() -> None:
    assert [name for name, field in Settings.model_fields.items() if len(field.description or "") < 10] == []
