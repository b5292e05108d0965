"""meta.toml: what it may say, and what is said back when it says something else."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.nav.types import VehicleClass
from server.replay.errors import ReplayError
from server.replay.meta import read_meta

WHOLE = """
[vehicle]
class = "fixed_wing"
[site]
lat_deg = 47.4
lon_deg = -8
alt_m = 500
date = 2026-07-02
[gnss]
delay_s = 0.12
lever_arm_b_m = [0.1, 0, -0.3]
[imu]
gyro_noise_rad_s_rthz = 1e-4
accel_noise_m_s2_rthz = 2e-3
gyro_bias_walk_rad_s2_rthz = 3e-5
accel_bias_walk_m_s3_rthz = 4e-4
[aids]
gnss = true
baro = false
mag = true
airspeed = false
"""


def overrides(tmp_path: Path, text: str) -> dict[str, object]:
    (tmp_path / "meta.toml").write_text(text, encoding="utf-8")
    return read_meta(tmp_path / "meta.toml").overrides()


def test_everything_it_can_say_reaches_the_engine_settings(tmp_path: Path) -> None:
    assert overrides(tmp_path, WHOLE) == {
        "vehicle": VehicleClass.FIXED_WING,
        "site_lat_deg": 47.4,
        "site_lon_deg": -8.0,
        "site_alt_m": 500.0,
        "decimal_year": 2026 + 182 / 365,
        "gnss_delay_s": 0.12,
        "lever_arm_b_m": (0.1, 0.0, -0.3),
        "gyro_noise_rad_s_rthz": 1e-4,
        "accel_noise_m_s2_rthz": 2e-3,
        "gyro_bias_walk_rad_s2_rthz": 3e-5,
        "accel_bias_walk_m_s3_rthz": 4e-4,
        "use_gnss": True,
        "use_baro": False,
        "use_mag": True,
        "use_airspeed": False,
    }


def test_no_file_and_an_empty_file_leave_every_delay_to_be_found_and_every_aid_on(tmp_path: Path) -> None:
    absent, empty = read_meta(tmp_path / "meta.toml").overrides(), overrides(tmp_path, "")
    assert absent == empty
    assert not [name for name in absent if name.endswith("_delay_s")]
    assert absent["use_gnss"] is absent["use_airspeed"] is True
    assert not {"vehicle", "decimal_year", "site_lat_deg", "gyro_noise_rad_s_rthz"} & set(absent)


@pytest.mark.parametrize(
    "date", ["2024-07-02", '"2024-07-02"', "2024-07-02T00:00:00", '"2024-07-02T00:00:00Z"', "2024-07-02T00:00:00Z"]
)
def test_a_date_may_be_toml_or_iso_text_with_or_without_time(tmp_path: Path, date: str) -> None:
    assert overrides(tmp_path, f"[site]\ndate = {date}\n")["decimal_year"] == 2024 + 183 / 366


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "[gnss]\ndelay_ms = 4",
            r"\[gnss\] delay_ms is not known \(did you mean delay_s\?\). Known here: delay_s, lever",
        ),
        (
            "[gps]\ndelay_s = 4",
            r"\[gps\] is not known \(did you mean gnss\?\). Known here: vehicle, site, gnss, imu, aids",
        ),
        ('[vehicle]\nclass = "plane"', r"\[vehicle\] class = 'plane' is refused: .*'fixed_wing'"),
        ('[vehicle]\nkind = "car"', r"\[vehicle\] kind is not known. Known here: class"),
        ("[site]\nlat_deg = 47", r"lat_deg and lon_deg go together"),
        ("[site]\nlat_deg = 91\nlon_deg = 0", r"\[site\] lat_deg = 91 is refused"),
        ("[site]\ndate = 2026", r"2026 is not a date: write date = 2026-11-22"),
        ('[site]\ndate = "soon"', r"'soon' is not a date"),
        ("[gnss]\nlever_arm_b_m = [1, 2]", r"\[gnss\] lever_arm_b_m"),
        ("[gnss]\ndelay_s = nan", r"\[gnss\] delay_s"),
        ("[imu]\ngyro_noise_rad_s_rthz = -1", r"gyro_noise_rad_s_rthz = -1 is refused: .*greater than 0"),
        ("[gnss]\ndelay_s = true", r"\[gnss\] delay_s = True is refused"),
        ('[gnss]\ndelay_s = "0.1"', r"\[gnss\] delay_s = '0.1' is refused"),
        ("[gnss]\nlever_arm_b_m = [0, true, 0]", r"\[gnss\] lever_arm_b_m = True is refused"),
        ("[site]\nlat_deg = 1\nlon_deg = false", r"\[site\] lon_deg = False is refused"),
        ('[site]\nalt_m = "12"', r"\[site\] alt_m = '12' is refused"),
        ("[imu]\ngyro_noise_rad_s_rthz = true", r"gyro_noise_rad_s_rthz = True is refused"),
        ("[aids]\nmag = 1", r"\[aids\] mag = 1 is refused"),
        ("site = 3", r"\[site\] = 3 is refused"),
        ("[site\n", r"is not valid TOML.*line 1"),
        ("[vehicle]\nclass = car", r"is not valid TOML.*need quotes"),
    ],
)
def test_what_it_may_not_say_is_named_with_its_place_and_remedy(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ReplayError, match=says):
        overrides(tmp_path, text)
