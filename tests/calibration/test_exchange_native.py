"""navdeck's own JSON gives back every number; the C header compiles and computes what we compute."""

import json
import shutil
import subprocess

import numpy as np
import pytest

from server.calibration.errors import ExchangeError
from server.calibration.exchange import export_calibration, import_calibration
from server.calibration.exchange.native import from_native
from server.calibration.records_json import to_json
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor
from server.nav.types import ROW_WIDTH, Kind
from tests.calibration.exchange_laws import (
    ACCEL_CROSS,
    AIRSPEED,
    BARO,
    COMMON,
    GYRO_SCALED,
    LEVEL,
    MAG,
    calibration,
    in_force,
)
from tests.calibration.store_sets import full_set

ALL = in_force(MAG, ACCEL_CROSS, GYRO_SCALED, LEVEL, AIRSPEED, BARO)


def imported(text):
    return import_calibration(text, name="x.json", board_id="other", created_by="operator", software_version="9")


def test_native_json_gives_back_every_field_exactly():
    sets = {**ALL, Sensor.MAG: full_set()}
    out = export_calibration("native", sets, **COMMON)
    back = {kept.sensor: kept for kept in from_native(out.text)}
    assert {sensor: to_json(kept) for sensor, kept in back.items()} == {s: to_json(kept) for s, kept in sets.items()}
    assert (out.name, out.warnings) == ("board-1.navdeck.json", ())


def test_an_imported_set_belongs_to_the_new_board_and_says_where_it_is_from():
    back = imported(export_calibration("native", in_force(MAG), **COMMON).text)
    (kept,) = back.sets
    assert (kept.id, kept.board_id, kept.source, kept.created_by) == ("", "other", "import:native", "operator")
    assert "id-mag of board board-1" in kept.note
    assert kept.parameters["offset"].tolist() == MAG.parameters["offset"].tolist()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"format": "navdeck.calibration/2"}, "newer"),
        ({"format": "something"}, "must say"),
        ({"sets": None}, "no list"),
        ({"sets": [1]}, "Set 0"),
        ({"sets": [{}]}, "Set 0"),
    ],
)
def test_a_file_that_is_not_ours_is_refused_with_the_reason(change, reason):
    body = json.loads(export_calibration("native", in_force(MAG), **COMMON).text)
    with pytest.raises(ExchangeError, match=reason):
        imported(json.dumps({**body, **change}))


def test_broken_json_is_refused():
    with pytest.raises(ExchangeError, match="not JSON"):
        imported("{")


MAIN = """
#include <stdio.h>
#include "navdeck.h"
int main(void)
{
    float raw[3], d[3], out[3];
    const float zero[3] = {0.0f, 0.0f, 0.0f};
    while (scanf("%f %f %f", &raw[0], &raw[1], &raw[2]) == 3) {
        navdeck_correct(navdeck_gyro_matrix, navdeck_gyro_offset_rad_s, raw, d);
        navdeck_correct(navdeck_level, zero, d, out);
        printf("%.9g %.9g %.9g ", out[0], out[1], out[2]);
        navdeck_correct(navdeck_accel_matrix, navdeck_accel_offset_m_s2, raw, d);
        navdeck_correct(navdeck_level, zero, d, out);
        printf("%.9g %.9g %.9g ", out[0], out[1], out[2]);
        navdeck_correct(navdeck_mag_matrix, navdeck_mag_offset_gauss, raw, d);
        navdeck_correct(navdeck_level, zero, d, out);
        printf("%.9g %.9g %.9g ", out[0], out[1], out[2]);
        printf("%.9g %.9g\\n", raw[0] - navdeck_diff_pressure_bias_pa, raw[1] - navdeck_baro_bias_m);
    }
    return 0;
}
"""
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]


def built(folder, header):
    (folder / "navdeck.h").write_text(header)
    (folder / "main.c").write_text(MAIN)
    flags = [flag for flag in WARNINGS if flag != "-Wdouble-promotion"]  # printf itself promotes
    subprocess.run(["cc", *flags, "-o", "main", "main.c"], cwd=folder, check=True)
    return folder / "main"


def computed_by_hand(header, raw):
    """Where there is no compiler: the tables read back from the text."""
    names = {}
    for part in header.split("static const float ")[1:]:
        head, _, rest = part.partition("=")
        body = rest[: rest.index(";")].replace("{", "[").replace("}", "]").replace("f", "")
        names[head.split("[")[0].strip()] = np.array(eval(body))
    level = names["navdeck_level"]
    parts = [
        (raw - names[f"navdeck_{name}"]) @ (level @ names[f"navdeck_{kind}_matrix"]).T
        for kind, name in (
            ("gyro", "gyro_offset_rad_s"),
            ("accel", "accel_offset_m_s2"),
            ("mag", "mag_offset_gauss"),
        )
    ]
    last = raw[:, :2] - [names["navdeck_diff_pressure_bias_pa"], names["navdeck_baro_bias_m"]]
    return np.hstack([*parts, last])


def wanted(whole, raw):
    rows = np.full((len(raw), ROW_WIDTH), np.nan)
    rows[:, :3], rows[:, 3:6] = raw, raw
    imu, mag = whole.rows(Kind.IMU, rows), whole.rows(Kind.MAG, rows)
    last = [raw[:, 0] - whole.diff_pressure_bias_pa, raw[:, 1] - whole.baro_bias_m]
    return np.column_stack([imu[:, :6], mag[:, :3], *last])


@pytest.mark.parametrize("sets", [ALL, {}], ids=["all", "none"])
def test_the_c_header_computes_what_preprocessing_computes(tmp_path, sets):
    header = export_calibration("c", sets, **COMMON).text
    raw = np.random.default_rng(1).normal(size=(20, 3))
    whole = calibration(sets) if sets else Calibration()
    np.testing.assert_allclose(computed_by_hand(header, raw), wanted(whole, raw), atol=1e-5)
    if shutil.which("cc"):
        text = "\n".join(" ".join(map(repr, row)) for row in raw.tolist())
        out = subprocess.run([built(tmp_path, header)], input=text, capture_output=True, text=True, check=True).stdout
        np.testing.assert_allclose(np.loadtxt(out.splitlines()), wanted(whole, raw), atol=1e-5)


def test_nothing_in_a_name_ends_the_comment_of_the_header():
    text = export_calibration("c", in_force(MAG), **{**COMMON, "board_id": "x */ int y; /*\\\n#error"}).text
    assert text.index("*/") > text.index("mag: import")
    assert not any(line.startswith("#error") for line in text.splitlines())
