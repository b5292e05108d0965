"""Options are checked once, with value, limit and remedy; ranges in each of their forms."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from server.calibrate.errors import CalibrateError
from server.calibrate.told import Told, kind_of, ranges_of
from server.nav.calibration.types import CalKind

SIX, SCALE = CalKind.ACCEL_SIX_POSITION, CalKind.GYRO_SCALE
FERRARIS = {"x_p": {"start": 540, "end": 1271}, "x_a": {"start": 1620, "end": 2361}, "y_rot": {"start": 7, "end": 9}}


@pytest.mark.parametrize("text", ["2:5,7:9", "[[2, 5], [7, 9]]", " [ [2,5],[7,9] ]", '[{"start":2,"end":5},["7",9]]'])
def test_stretches_are_half_open_pairs(text: str) -> None:
    assert ranges_of(text, SIX, "") == ((2, 5), (7, 9))


def test_a_file_of_named_stretches_gives_each_kind_its_own(tmp_path: Path) -> None:
    path = tmp_path / "list.json"
    path.write_text(json.dumps(FERRARIS))
    assert ranges_of(str(path), SIX, "") == ((540, 1271), (1620, 2361))
    assert ranges_of(str(path), SCALE, "y") == ranges_of(str(path), SCALE, "") == ((540, 1271), (1620, 2361), (7, 9))
    assert ranges_of(json.dumps({"x_rot": {"start": 1, "end": 2}}), SCALE, "") == ((1, 2),)
    with pytest.raises(CalibrateError, match=r"names the turns y_rot; --axis x has none"):
        ranges_of(str(path), SCALE, "x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5:2", r"--ranges 5:2 holds no sample\. Give a:b with 0 ≤ a < b"),
        ("-3:2", r"-3:2 holds no sample"),
        ("2-5", r"--ranges '2-5' is refused\. Write sample indices a:b"),
        ("1:2:3", r"is refused"),
        ("", r"is refused"),
        ("[1, 2", r"is not JSON"),
        ('{"a": 3}', r"is refused"),
        ("nowhere.json", r"nowhere\.json cannot be read: No such file"),
    ],
)
def test_what_is_no_stretch_is_refused_with_the_form(text: str, message: str) -> None:
    with pytest.raises(CalibrateError, match=message):
        ranges_of(text, SIX, "")


def test_a_kind_is_known_with_hyphens_too_and_a_wrong_one_names_the_nearest() -> None:
    assert kind_of("Mag-Ellipsoid") is CalKind.MAG_ELLIPSOID
    with pytest.raises(CalibrateError, match=r"'mag_elipsoid' is not known \(did you mean mag_ellipsoid\?\).*level"):
        kind_of("mag_elipsoid")


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"unit": "uT"}, r"--unit uT is not known\. Give si or raw"),
        ({"axis": "w"}, r"--axis w is not known\. Give x or y or z"),
        ({"parameters": 7}, r"--parameters 7 is not known\. Give 6 or 9"),
        ({"strength": 0.0}, r"--strength 0 is refused: it must be a finite number above 0"),
        ({"strength": math.inf}, r"--strength inf"),
        ({"gravity_m_s2": -9.8}, r"--gravity -9\.8 is refused"),
        ({"rate_hz": 0.0}, r"--rate-hz 0 is refused: .* in 0 to 1e\+06"),
        ({"turns": 0.0}, r"--turns 0 is refused"),
        ({"lat_deg": 91.0, "lon_deg": 0.0}, r"--lat-deg 91 .* in -90 to 90"),
        ({"lat_deg": 47.0}, r"go together"),
        ({"duration_s": -1.0}, r"--duration-s -1"),
        ({"files": ()}, r"no FILE is given"),
    ],
)
def test_a_value_outside_its_limits_is_refused_with_them(told: dict[str, object], message: str) -> None:
    with pytest.raises(CalibrateError, match=message):
        Told(**{"kind": SIX, "files": (Path("a.csv"),), **told})
