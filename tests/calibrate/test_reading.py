"""What a CSV means: names, units, delimiters, times, several files. Collectors are not involved."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from server.calibrate.errors import CalibrateError
from server.calibrate.pieces import Samples, read_csvs
from server.calibrate.told import Told
from server.nav.calibration.types import CalKind
from server.nav.types import SAMPLE_COLUMNS, Kind

MAG, ACCEL, BIAS = CalKind.MAG_ELLIPSOID, CalKind.ACCEL_MULTI_POSE, CalKind.GYRO_BIAS
HEADING = CalKind.MAG_FIXED_HEADING


def put(folder: Path, text: str | bytes, name: str = "a.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(paths: Path | list[Path], kind: CalKind = MAG, **told: object) -> Samples:
    files = paths if isinstance(paths, list) else [paths]
    return read_csvs(files, Told(kind=kind, files=tuple(files), **told))


def field(samples: Samples) -> list[list[float]]:
    assert {piece.kind for piece in samples.pieces} == {Kind.MAG}
    return np.concatenate([piece.rows[:, :3] for piece in samples.pieces]).tolist()


def stamps(samples: Samples) -> list[int]:
    return np.concatenate([piece.t_ns for piece in samples.pieces]).tolist()


@pytest.mark.parametrize(
    "text",
    [
        "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n5,0.1,-0.2,0.3\n9007199254740993,1,2,3\n",
        '\ufeffmag_z_gauss , mag_x_gauss,"MAG_Y_Gauss",t_ns\r\n.3,.1,-.2,5\r\n3,1,2,9007199254740993\r\n',
        "t_ns;mag_x_gauss;mag_y_gauss;mag_z_gauss\n5;0,1;-0,2;0,3\n9007199254740993;1;2;3",
        "t_ns\tmag_x_gauss\tmag_y_gauss\tmag_z_gauss\n5\t1e-1\t-2e-1\t3E-1\n9007199254740993\t1\t2\t3\n",
        "  t_ns mag_x_gauss   mag_y_gauss mag_z_gauss \n   5  0.1 -0.2   0.3  \n9007199254740993 1 2 3\n\n",
        "# a sweep\n# t_ns mag_x_gauss mag_y_gauss mag_z_gauss\n5 0.1 -0.2 0.3\n9007199254740993 1 2 3\n",
        "# by hand\nt_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\r5,0.1,-0.2,0.3\r9007199254740993,1,2,3\r",
    ],
    ids=["comma", "any-order-bom-crlf", "semicolon-decimal-comma", "tab", "blanks", "numpy-comment", "cr"],
)
def test_every_usual_way_to_write_a_table_gives_the_same_samples_and_exact_stamps(tmp_path: Path, text: str) -> None:
    found = read(put(tmp_path, text))
    assert field(found) == [[0.1, -0.2, 0.3], [1.0, 2.0, 3.0]]
    assert stamps(found) == [5, 9007199254740993]
    assert found.has_stamps


@pytest.mark.parametrize(
    ("kind", "name", "value", "expected"),
    [
        (MAG, "mag_{}_gauss", 0.25, 0.25),
        (MAG, "mag_{}_mgauss", 250.0, 0.25),
        (MAG, "mag_{}_milligauss", 250.0, 0.25),
        (MAG, "mag_{}_uT", 25.0, 0.25),
        (MAG, "mag_{}_nT", 25000.0, 0.25),
        (BIAS, "gyro_{}_rad_s", 0.5, 0.5),
        (BIAS, "gyro_{}_mrad_s", 500.0, 0.5),
        (BIAS, "gyr_{}_deg_s", 90.0, math.pi / 2),
        (BIAS, "gyro_{}_dps", -180.0, -math.pi),
        (ACCEL, "accel_{}_m_s2", 9.8, 9.8),
        (ACCEL, "acc_{}_g", 1.0, 9.80665),
        (ACCEL, "accel_{}_mg", 1000.0, 9.80665),
    ],
)
def test_a_unit_in_the_name_is_converted_to_si(
    tmp_path: Path, kind: CalKind, name: str, value: float, expected: float
) -> None:
    header = ",".join(name.format(axis) for axis in "xyz")
    path = put(tmp_path, f"t_s,{header}\n0.5,{value},{2 * value},{-value}\n")
    piece = read(path, kind).pieces[0]
    first = 3 if kind is ACCEL else 0
    np.testing.assert_allclose(piece.rows[0, first : first + 3], [expected, 2 * expected, -expected], rtol=1e-15)
    raw = read(path, kind, unit="raw").pieces[0]
    assert raw.rows[0, first] == value
    assert piece.t_ns.tolist() == [500_000_000]


@pytest.mark.parametrize("kind", [Kind.IMU, Kind.MAG, Kind.BARO, Kind.AIRSPEED])
def test_the_core_s_own_column_names_go_to_their_own_places(tmp_path: Path, kind: Kind) -> None:
    names = SAMPLE_COLUMNS[kind]
    cal = {
        Kind.IMU: BIAS,
        Kind.MAG: MAG,
        Kind.BARO: CalKind.BARO_REFERENCE,
        Kind.AIRSPEED: CalKind.AIRSPEED_ZERO,
    }[kind]
    path = put(tmp_path, ",".join(["t_ns", *names]) + "\n7," + ",".join(str(k + 1.5) for k in range(len(names))) + "\n")
    (piece,) = read(path, cal).pieces
    assert piece.kind is kind
    assert piece.rows[0, : len(names)].tolist() == [k + 1.5 for k in range(len(names))]
    assert np.isnan(piece.rows[0, len(names) :]).all()


@pytest.mark.parametrize(
    ("kind", "sample_kind", "first"), [(MAG, Kind.MAG, 0), (ACCEL, Kind.IMU, 3), (BIAS, Kind.IMU, 0)]
)
def test_x_y_z_are_the_sensor_of_the_kind(tmp_path: Path, kind: CalKind, sample_kind: Kind, first: int) -> None:
    (piece,) = read(put(tmp_path, "x,y,z\n100,200,300\n"), kind, unit="raw").pieces
    assert piece.kind is sample_kind
    assert piece.rows[0, first : first + 3].tolist() == [100.0, 200.0, 300.0]


def test_without_time_the_samples_are_a_hundredth_apart_or_as_told_and_the_count_goes_on(tmp_path: Path) -> None:
    a, b = put(tmp_path, "x,y,z\n1,2,3\n4,5,6\n"), put(tmp_path, "x,y,z\n7,8,9\n", "b.csv")
    assert stamps(read([a, b], unit="raw")) == [0, 10_000_000, 20_000_000]
    told = read([a, b], unit="raw", rate_hz=4.0)
    assert stamps(told) == [0, 250_000_000, 500_000_000]
    assert field(told) == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert not told.has_stamps


def test_three_columns_without_a_header_are_x_y_z_when_raw_and_it_is_said(tmp_path: Path) -> None:
    found = read(put(tmp_path, "9996,-9059,5700\r\n10018,-9048,5649\r\n"), unit="raw")
    assert field(found) == [[9996, -9059, 5700], [10018, -9048, 5649]]
    assert any("no header" in note for note in found.notes)


def test_told_names_stand_for_a_missing_header(tmp_path: Path) -> None:
    path = put(tmp_path, "   2.984e-02   3.3108e+04   3.3329e+04   3.6429e+04\n   3.9857e-02 1 2 3\n")
    found = read(path, ACCEL, unit="raw", columns=("t_s", "x", "y", "z"))
    assert stamps(found) == [29_840_000, 39_857_000]
    assert found.pieces[0].rows[0, 3:6].tolist() == [33108.0, 33329.0, 36429.0]


def test_the_finest_time_is_taken_and_a_float_t_ns_is_rounded(tmp_path: Path) -> None:
    path = put(tmp_path, "time_s,t_us,x,y,z\n1,1000001,1,2,3\n")
    assert stamps(read(path, unit="raw")) == [1_000_001_000]
    assert stamps(read(put(tmp_path, "t_ns,x,y,z\n1.5e9,1,2,3\n"), unit="raw")) == [1_500_000_000]


def test_a_bare_time_is_seconds_when_its_steps_are(tmp_path: Path) -> None:
    found = read(put(tmp_path, "time,x,y,z\n0.00,1,2,3\n0.02,1,2,3\n0.04,1,2,3\n"), unit="raw")
    assert stamps(found) == [0, 20_000_000, 40_000_000]
    assert any("seconds" in note for note in found.notes)
    with pytest.raises(CalibrateError, match=r"column time says no unit and its steps of 20 .*t_ms"):
        read(put(tmp_path, "time,x,y,z\n0,1,2,3\n20,1,2,3\n"), unit="raw")


def test_an_unknown_cell_is_unknown_and_a_strange_column_is_noted(tmp_path: Path) -> None:
    found = read(put(tmp_path, "t_ns,n_samples,mag_x_gauss,mag_y_gauss,mag_z_gauss\n1,0,,0.2,nan\n2,1,1,2,3\n"))
    np.testing.assert_array_equal(field(found), [[np.nan, 0.2, np.nan], [1, 2, 3]])
    assert any("n_samples" in note for note in found.notes)


def test_a_cut_last_line_is_left_out_and_said(tmp_path: Path) -> None:
    found = read(put(tmp_path, "x,y,z\n1,2,3\n4,5"), unit="raw")
    assert field(found) == [[1, 2, 3]]
    assert any("cut off" in note for note in found.notes)


IMU_HEADER = "t_ns,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n"
MAG_HEADER = "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n"


def test_files_of_different_sensors_are_merged_by_their_stamps_the_imu_last(tmp_path: Path) -> None:
    imu = put(tmp_path, IMU_HEADER + "1,0,0,0,0,0,-9\n2,0,0,0,0,0,-9\n3,0,0,0,0,0,-9\n", "imu.csv")
    mag = put(tmp_path, MAG_HEADER + "2,1,2,3\n", "mag.csv")
    for files in ([imu, mag], [mag, imu]):
        found = read(files, HEADING)
        assert [(p.kind, p.t_ns.tolist()) for p in found.pieces] == [
            (Kind.IMU, [1]),
            (Kind.MAG, [2]),
            (Kind.IMU, [2, 3]),
        ]


def test_files_whose_stamps_begin_again_are_read_one_after_the_other(tmp_path: Path) -> None:
    one = put(tmp_path, MAG_HEADER + "5,1,2,3\n6,1,2,3\n", "one.csv")
    two = put(tmp_path, MAG_HEADER + "0,4,5,6\n", "two.csv")
    assert stamps(read([one, two])) == [5, 6, 0]


def test_a_gyro_file_and_an_accelerometer_file_of_equal_stamps_become_one(tmp_path: Path) -> None:
    acc = put(tmp_path, "t_s,accel_x_g,accel_y_g,accel_z_g\n0.1,0,0,1\n0.2,0,0,1\n", "acc.csv")
    gyr = put(tmp_path, "t_s,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s\n0.1,180,0,0\n0.2,0,0,0\n", "gyr.csv")
    (piece,) = read([acc, gyr], ACCEL).pieces
    np.testing.assert_allclose(piece.rows[0, :6], [math.pi, 0, 0, 0, 0, 9.80665])


@pytest.mark.parametrize(
    ("text", "kind", "told", "message"),
    [
        ("x,y,z\n1,2,3\n", MAG, {}, r"column x says no unit\. Give --unit si when it is in gauss, --unit raw"),
        ("t_ns,mag_x_tesla,mag_y_tesla,mag_z_tesla\n1,2,3,4\n", MAG, {}, r"column mag_x_tesla is not known.*mag_x_ut"),
        ("mag_x_gauss,mag_x_ut,mag_y_ut,mag_z_ut\n1,1,2,3\n", MAG, {}, r"mag_x_gauss and mag_x_ut are both mag's"),
        ("x,x,y,z\n1,1,2,3\n", MAG, {"unit": "raw"}, r"columns x and x are both"),
        ("mag_x_gauss,mag_y_gauss\n1,2\n", MAG, {}, r"mag has no z\. Three axes are needed"),
        ("t_ns,pressure_pa\n1,2\n", MAG, {}, r"no column of mag, which mag_ellipsoid needs\. Accepted: mag_x_gauss"),
        ("t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n1,2,3,4\n", HEADING, {}, r"no column of accel"),
        ("t_min,x,y,z\n1,1,2,3\n", MAG, {"unit": "raw"}, r"column t_min is not known\. Accepted for time: t_ns, t_us"),
        ("1,2,3\n", MAG, {}, r"names no column \(3 columns\).*--unit raw"),
        ("1,2,3,4\n", MAG, {"unit": "raw"}, r"names no column \(4 columns\).*--columns with 4 names"),
        ("x,y,z\n1,2,3\n1,two,3\n", MAG, {"unit": "raw"}, r"line 3, column y: 'two' is not a number"),
        ("# c\nx,y,z\n1,2,3\n1,2,3,4\n", MAG, {"unit": "raw"}, r"line 4 has 4 cells instead of 3"),
        ("x,y,z\n1,2\n1,2,3\n", MAG, {"unit": "raw"}, r"line 2 has 2 cells instead of 3"),
        ("t_s,x,y,z\n1,1,2,3\n,1,2,3\n", MAG, {"unit": "raw"}, r"column t_s, sample 1: nan is no time"),
        ("", MAG, {}, r"is empty"),
        ("x,y,z\n1,2,3\n", MAG, {"unit": "raw", "columns": ("x", "y", "z")}, r"line 1 names the columns already"),
        (b"PK\0\0", MAG, {}, r"not plain text"),
    ],
)
def test_what_cannot_be_read_says_where_what_and_the_remedy(
    tmp_path: Path, text: str | bytes, kind: CalKind, told: dict[str, object], message: str
) -> None:
    with pytest.raises(CalibrateError, match=message):
        read(put(tmp_path, text), kind, **told)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrateError, match=r"none\.csv cannot be read: No such file"):
        read(tmp_path / "none.csv")
