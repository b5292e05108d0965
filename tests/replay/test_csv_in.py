"""One CSV file: columns by name, exact values, and errors that say where and what to do."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from server.replay.csv_in import Read, read_table
from server.replay.errors import ReplayError
from server.replay.tables import TABLES

TABLE = {table.stem: table for table in TABLES}
MAG = "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n"


def read(tmp_path: Path, text: str | bytes, stem: str = "mag") -> Read:
    path = tmp_path / f"{stem}.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(path, TABLE[stem])


def test_values_are_those_python_reads_and_stamps_are_exact_beyond_2_to_the_53(tmp_path: Path) -> None:
    rng = random.Random(3)
    rows = [
        (2**53 + 1 + 7 * k, *(rng.uniform(-1, 1) * 10.0 ** rng.randint(-12, 3) for _ in range(3))) for k in range(999)
    ]
    found = read(tmp_path, MAG + "".join(f"{t},{x!r},{y!r},{z!r}\n" for t, x, y, z in rows))
    assert found.t_ns.tolist() == [row[0] for row in rows]
    assert found.data[:, :3].tolist() == [list(row[1:]) for row in rows]
    assert np.isnan(found.data[:, 3:]).all()


def test_columns_are_found_by_name_in_any_order_and_strangers_are_noted(tmp_path: Path) -> None:
    found = read(tmp_path, "mag_z_gauss,temp,t_ns,mag_x_gauss,mag_y_gaus,mag_y_gauss\n3,text,5,1,x,2\n")
    assert (found.t_ns.tolist(), found.data[0, :3].tolist()) == ([5], [1.0, 2.0, 3.0])
    assert "temp" in found.notes[0]
    assert "mag_y_gaus" in found.notes[0]


@pytest.mark.parametrize(
    "text",
    [
        b"\xef\xbb\xbf" + MAG.encode() + b"5,1,2,3\n7,4,,6\n",
        (MAG + "5,1,2,3\n7,4,,6\n").replace("\n", "\r\n").encode(),
        (MAG + "5,1,2,3\n\n7,4,,6\n\n\n").encode(),
        (MAG + "5,1,2,3\n7,4,,6").encode(),
        b'"t_ns", "mag_x_gauss","mag_y_gauss" ,mag_z_gauss\n 5 ,"1",+2.0 ,\t3e0\n7,4,NaN,6\n',
    ],
    ids=["byte order mark", "CRLF", "blank lines", "no last newline", "quotes and blanks"],
)
def test_the_habits_of_other_programs_are_accepted(tmp_path: Path, text: bytes) -> None:
    found = read(tmp_path, text)
    assert found.t_ns.tolist() == [5, 7]
    np.testing.assert_array_equal(found.data[:, :3], [[1, 2, 3], [4, np.nan, 6]])
    assert found.truncated == 0


def test_numbers_of_more_digits_than_the_kernel_takes_and_infinities_are_pythons(tmp_path: Path) -> None:
    long = "0.12345678901234567890123456789"
    found = read(tmp_path, MAG + "".join(f"{k},{long},inf,-Infinity\n" for k in range(3000)))
    assert found.data[2999, :3].tolist() == [float(long), np.inf, -np.inf]


def test_a_line_cut_off_at_the_end_of_the_file_is_left_out_and_counted(tmp_path: Path) -> None:
    found = read(tmp_path, MAG + "5,1,2,3\n7,4,")
    assert (found.t_ns.tolist(), found.truncated) == ([5], 1)


def test_a_header_alone_is_an_empty_table(tmp_path: Path) -> None:
    assert len(read(tmp_path, MAG).t_ns) == len(read(tmp_path, MAG.rstrip()).t_ns) == 0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            MAG + "5,1,2,3\n6,x7,2,3\n",
            r"mag\.csv: line 3, column mag_x_gauss: 'x7' is not a number.*leave the cell empty",
        ),
        (MAG + "5,1,2,3\n6,1_0,2,3\n", r"line 3, column mag_x_gauss: '1_0' is not a number"),
        (MAG + "5,1,2,3\n6.5,1,2,3\n", r"line 3, column t_ns: '6\.5' is not an integer.*multiply seconds"),
        (MAG + "5,1,2,3\n,1,2,3\n", r"line 3, column t_ns: '' is not an integer"),
        (MAG + "1e9,1,2,3\n", r"line 2, column t_ns: '1e9' is not an integer"),
        (MAG + "5,1,2,3\n6,1,2\n7,1,2,3\n", r"line 3 has 3 cells where line 1 names 4 columns"),
        (MAG + "5,1,2,3\n6,1,2,3,4\n", r"line 3 has 5 cells where line 1 names 4 columns"),
        ("t_ns,mag_x,mag_y_gauss,mag_z_gauss\n1,2,3,4\n", r"no column mag_x_gauss \(did you mean mag_x\?\)"),
        ("time,mag_x_gauss,mag_y_gauss,mag_z_gauss\n1,2,3,4\n", r"line 1 has no column t_ns"),
        (MAG.strip() + ",t_ns\n1,2,3,4,5\n", r"line 1 names t_ns more than once"),
        ("", r"line 1 is empty"),
        (MAG.encode("utf-16"), r"is not plain text.*UTF-8"),
        ("t_ns;mag_x_gauss;mag_y_gauss;mag_z_gauss\n1;2;3;4\n", r"line 1 has no column t_ns"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_place_and_remedy(tmp_path: Path, text: str | bytes, says: str) -> None:
    with pytest.raises(ReplayError, match=says):
        read(tmp_path, text)


def test_either_of_two_alternatives_suffices_but_not_neither(tmp_path: Path) -> None:
    assert read(tmp_path, "t_ns,altitude_m\n1,2\n", "baro").data[0, 1] == 2.0
    assert read(tmp_path, "t_ns,pressure_pa\n1,2\n", "baro").notes == ()
    with pytest.raises(ReplayError, match="no column pressure_pa or altitude_m"):
        read(tmp_path, "t_ns,temperature_degc\n1,2\n", "baro")


def test_absent_gnss_columns_are_unknown_and_say_so(tmp_path: Path) -> None:
    found = read(tmp_path, "t_ns,lat_deg,lon_deg,alt_m\n1,47,8,500\n", "gnss")
    assert np.isnan(found.data[0, 3:]).all()
    assert "vel_n_m_s" in found.notes[0]
