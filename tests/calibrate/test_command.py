"""`navdeck calibrate` from the outside: exit status, what goes where, JSON as its schema says, several files."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from server.calibrate import command
from server.calibrate.contract import schema_text
from server.calibrate.schemas import path as schema_path
from server.calibrate.told import Told
from server.cli import app
from server.magnetic import wmm_field
from server.nav.calibration.codes import FAILURES
from server.nav.calibration.types import CalKind
from tests.calibrate.cal_files import (
    FACES_DOWN,
    G_M_S2,
    IMU_HEADER,
    S0_ACCEL_OFFSET,
    S0_GYRO_BIAS,
    S0_MAG_CENTRE,
    S0_MAG_RADII,
    S0_T,
    s0_poses,
    s0_sweep,
    sphere,
    stamps_ns,
    write,
)

KEYS = [
    "ok",
    "kind",
    "failure",
    "parameters",
    "sigma",
    "residual_before",
    "residual_after",
    "coverage",
    "grade",
    "samples",
    "temperature_degc",
    "details",
    "notes",
    "software_version",
    "check",
]
VALIDATOR = Draft202012Validator(json.loads(schema_path().read_text(encoding="utf-8")))


def navdeck(*args: object) -> tuple[int, str, str]:
    """Run the command line in this process; return its status and what it said."""
    done = CliRunner().invoke(app, ["calibrate", *map(str, args)])
    return done.exit_code, done.stdout, done.stderr


def result(*args: object, status: int = 0) -> dict[str, Any]:
    """Run it with --json; the answer has the status, nothing else on either stream, and is what the schema says."""
    code, out, err = navdeck(*args, "--json")
    assert (code, err) == (status, ""), err or out
    found = json.loads(out, parse_constant=pytest.fail)
    assert list(found) == KEYS
    VALIDATOR.validate(found)
    return dict(found)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("mag") / "sweep.csv", "x,y,z", s0_sweep(np.random.default_rng(3)))


@pytest.fixture(scope="module")
def faces(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows = s0_poses(np.random.default_rng(5), FACES_DOWN)
    return write(tmp_path_factory.mktemp("six") / "imu.csv", IMU_HEADER, rows, stamps_ns(len(rows), 100.0))


def within_3_sigma(found: dict[str, Any], name: str, truth: np.ndarray, factor: float = 1.0) -> None:
    error = np.abs(np.array(found["parameters"][name], dtype=float) - truth)
    sigma = np.array(found["sigma"][name], dtype=float)
    assert (sigma > 0).all()
    assert (error <= 3.0 * factor * sigma).all(), (error / sigma).max()


def test_the_shipped_schema_is_the_generated_one_and_refuses_strangers(sweep: Path) -> None:
    assert schema_path().read_text(encoding="utf-8") == schema_text(), "run python -m server.calibrate.schemas"
    Draft202012Validator.check_schema(VALIDATOR.schema)
    found = result("mag_ellipsoid", sweep, "--unit", "raw")
    for broken in (
        {**found, "extra": 1},
        {**found, "grade": "great"},
        {**found, "parameters": {"offset": [1, 2]}},
        {**found, "parameters": {"angle": 1}},
        {key: value for key, value in found.items() if key != "failure"},
    ):
        with pytest.raises(ValidationError):
            VALIDATOR.validate(broken)


def test_s0_s_ellipsoid_through_noise_comes_back_within_its_3_sigma(sweep: Path) -> None:
    found = result("mag_ellipsoid", sweep, "--unit", "raw")
    assert found["ok"]
    assert found["failure"] is None
    within_3_sigma(found, "offset", S0_MAG_CENTRE)
    within_3_sigma(found, "matrix", np.diag(1.0 / S0_MAG_RADII))
    matrix = np.array(found["parameters"]["matrix"])
    assert (matrix == matrix.T).all()
    assert found["residual_after"]["value"] < 0.01 < found["residual_before"]["value"]
    told = result("mag_ellipsoid", sweep, "--unit", "raw", "--strength", "0.48")
    np.testing.assert_allclose(told["parameters"]["matrix"], 0.48 * matrix, rtol=1e-12)
    assert told["parameters"]["offset"] == found["parameters"]["offset"]


def test_s0_s_accelerometer_through_noise_comes_back_within_its_3_sigma(faces: Path) -> None:
    found = result("accel_six_position", faces)
    within_3_sigma(found, "offset", S0_ACCEL_OFFSET)
    within_3_sigma(found, "matrix", S0_T)
    assert found["residual_after"] == {"value": pytest.approx(0.0, abs=0.02), "unit": "m/s²"}


def test_s0_s_gyro_bias_through_noise_comes_back_within_its_3_sigma(tmp_path: Path) -> None:
    rows = s0_poses(np.random.default_rng(11), np.array([[0.0, 0.0, 1.0]]))[:400]
    whole = write(tmp_path / "rest.csv", IMU_HEADER, rows, stamps_ns(400, 100.0))
    found = result("gyro_bias", whole)
    within_3_sigma(found, "bias", S0_GYRO_BIAS)
    header = "t_s,gyr_x_deg_s,gyr_y_deg_s,gyr_z_deg_s"
    degrees = np.column_stack([np.arange(400) * 0.01, np.degrees(rows[:, :3])])
    other = result("gyro_bias", write(tmp_path / "degrees.csv", header, degrees))
    np.testing.assert_allclose(other["parameters"]["bias"], found["parameters"]["bias"], rtol=1e-9)


@pytest.mark.parametrize("cut", [1, 333, 1199])
def test_one_file_cut_in_two_gives_the_same_to_the_last_bit(tmp_path: Path, sweep: Path, cut: int) -> None:
    lines = sweep.read_text().splitlines(keepends=True)
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    a.write_text("".join(lines[: cut + 1]))
    b.write_text(lines[0] + "".join(lines[cut + 1 :]))
    assert result("mag_ellipsoid", a, b, "--unit", "raw") == result("mag_ellipsoid", sweep, "--unit", "raw")


def test_poses_cut_in_two_files_and_one_file_a_pose_give_the_same_faces(tmp_path: Path, faces: Path) -> None:
    whole = result("accel_six_position", faces)
    lines = faces.read_text().splitlines(keepends=True)
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    a.write_text("".join(lines[:701]))
    b.write_text(lines[0] + "".join(lines[701:]))
    assert result("accel_six_position", a, b) == whole
    each = []
    for k in range(6):
        each.append(tmp_path / f"pose{k}.csv")
        each[-1].write_text(lines[0] + "".join(lines[1 + 500 * k : 1 + 500 * k + 400]))
    backwards = result("accel_six_position", *reversed(each))
    np.testing.assert_allclose(backwards["parameters"]["offset"], whole["parameters"]["offset"], atol=2e-3)
    np.testing.assert_allclose(backwards["parameters"]["matrix"], whole["parameters"]["matrix"], atol=2e-3)


def test_ranges_are_the_poses_in_every_form(tmp_path: Path, faces: Path) -> None:
    pairs = [[500 * k + 20, 500 * k + 380] for k in range(6)]
    text = ",".join(f"{a}:{b}" for a, b in pairs)
    named = tmp_path / "list.json"
    named.write_text(json.dumps({f"p{k}": {"start": a, "end": b} for k, (a, b) in enumerate(pairs)}))
    found = [result("accel_six_position", faces, "--ranges", r) for r in (text, json.dumps(pairs), named)]
    assert found[0] == found[1] == found[2]
    told = sum(b - a for a, b in pairs)
    assert 0.95 * told < found[0]["samples"] <= told  # samples are taken in small blocks, a last partial one is not
    within_3_sigma(found[0], "offset", S0_ACCEL_OFFSET)
    code, out, err = navdeck("accel_six_position", faces, "--ranges", "0:10,2990:3001")
    assert (code, out) == (2, "")
    assert "--ranges 2990:3001 ends after the last of 3000 samples" in err


def test_half_a_sphere_s_equator_is_refused_with_status_3_and_empty_parameters(tmp_path: Path) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 500)
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0.002 * np.sin(9.0 * angle)]) * 300.0 + [20.0, -30.0, 10.0]
    path, out = write(tmp_path / "flat.csv", "x,y,z", ring), tmp_path / "r.json"
    found = result("mag_ellipsoid", path, "--unit", "raw", "--out", out, status=3)
    assert not found["ok"]
    assert found["failure"]["code"] in {"coverage-planar", "coverage-poor"}
    assert found["failure"]["advice"] == FAILURES[found["failure"]["code"]]
    assert (found["parameters"], found["sigma"], found["grade"]) == ({}, {}, None)
    assert json.loads(out.read_text()) == found
    code, text, err = navdeck("mag_ellipsoid", path, "--unit", "raw")
    assert (code, err) == (3, "")
    assert "REFUSED" in text
    assert found["failure"]["advice"] in text


def test_a_header_without_samples_is_refused_not_an_error(tmp_path: Path) -> None:
    path = tmp_path / "empty.csv"
    path.write_text("t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss\n")
    found = result("mag_ellipsoid", path, status=3)
    assert found["failure"]["code"] in {"no-data", "too-few-samples"}
    assert found["samples"] == 0


def test_fresh_data_are_judged_and_a_magnet_put_on_shows(tmp_path: Path, sweep: Path) -> None:
    rng = np.random.default_rng(8)
    fresh = write(tmp_path / "fresh.csv", "x,y,z", s0_sweep(rng))
    magnet = write(tmp_path / "magnet.csv", "x,y,z", s0_sweep(rng) + np.array([150.0, 0.0, 0.0]))
    good = result("mag_ellipsoid", sweep, "--unit", "raw", "--verify", fresh)
    assert good["check"]["ok"]
    assert good["check"]["failure"] is None
    bad = result("mag_ellipsoid", sweep, "--unit", "raw", "--verify", magnet)
    assert not bad["check"]["ok"]
    assert bad["check"]["residual"]["value"] > bad["check"]["limit"]
    assert bad["parameters"] == good["parameters"]
    assert result("mag_ellipsoid", sweep, "--unit", "raw")["check"] is None


def test_the_place_gives_the_field_s_strength(tmp_path: Path) -> None:
    field = sphere(600) * 0.48 + [0.1, -0.05, 0.02]  # 47.4° N 8.5° E: 0.48 gauss
    path = write(tmp_path / "m.csv", "mag_x_gauss,mag_y_gauss,mag_z_gauss", field)
    place = ("--lat-deg", 47.4, "--lon-deg", 8.5, "--alt-m", 500, "--year", 2026.9)
    found = result("mag_ellipsoid", path, *place)
    told = result("mag_ellipsoid", path, "--strength", 0.4843)
    np.testing.assert_allclose(found["parameters"]["matrix"], told["parameters"]["matrix"], rtol=2e-3, atol=1e-6)
    assert found["residual_after"]["unit"] == "gauss"
    weak = write(tmp_path / "weak.csv", "mag_x_gauss,mag_y_gauss,mag_z_gauss", sphere(600) * 0.2)
    refused = result("mag_ellipsoid", weak, *place, status=3)
    assert refused["failure"]["code"] == "field-strength"


def test_level_takes_the_accelerometer_s_earlier_result_first(tmp_path: Path, faces: Path) -> None:
    rows = s0_poses(np.random.default_rng(2), np.array([[0.0, 0.0, 1.0]]))[:400]
    still = write(tmp_path / "level.csv", IMU_HEADER, rows, stamps_ns(400, 100.0))
    earlier = tmp_path / "accel.json"
    assert navdeck("accel_six_position", faces, "--out", earlier)[0] == 0

    def tilt(*more: object) -> float:
        down = np.array(result("level", still, *more)["parameters"]["matrix"])[2]
        return math.degrees(math.acos(min(1.0, down[2])))

    raw_mean = np.linalg.inv(S0_T) @ [0.0, 0.0, -G_M_S2] + S0_ACCEL_OFFSET
    expected = math.degrees(math.acos(-raw_mean[2] / np.linalg.norm(raw_mean)))
    assert tilt() == pytest.approx(expected, abs=0.05)
    assert expected > 0.5
    assert tilt("--applied", earlier) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("mag_elipsoid", "a.csv"), "did you mean mag_ellipsoid"),
        (("mag_ellipsoid", "none.csv"), "none.csv cannot be read"),
        (("mag_ellipsoid", "SWEEP"), "column x says no unit"),
        (("mag_ellipsoid", "SWEEP", "--unit", "tesla"), "Give si or raw"),
        (("airspeed_zero", "SWEEP", "--unit", "raw"), "which airspeed_zero needs. Accepted: diff_pressure_pa"),
        (("mag_ellipsoid", "SWEEP", "FOLDER", "--unit", "raw"), "is a log and stands alone"),
        (("mag_ellipsoid", "FOLDER"), "holds none of mag.csv"),
        (("mag_ellipsoid", "SWEEP", "--unit", "raw", "--out", "FOLDER/no/r.json"), "--out"),
        (("level", "SWEEP", "--unit", "si", "--applied", "SWEEP"), "is not a result of this command"),
        (("mag_ellipsoid", "SWEEP", "--unit", "raw", "--verify", "none.csv"), "none.csv cannot be read"),
    ],
)
def test_bad_input_is_status_2_with_one_message_and_an_empty_output(
    tmp_path: Path, sweep: Path, args: tuple[str, ...], message: str
) -> None:
    told = [arg.replace("SWEEP", str(sweep)).replace("FOLDER", str(tmp_path)) for arg in args]
    for more in ((), ("--json",)):
        code, out, err = navdeck(*told, *more)
        assert (code, out) == (2, "")
        assert message in err
        assert err.count("\n") == 1


def test_the_table_has_every_number_with_its_sigma_and_what_the_grade_means(sweep: Path) -> None:
    code, text, err = navdeck("mag_ellipsoid", sweep, "--unit", "raw")
    assert (code, err) == (0, "")
    for word in ("offset  x", "matrix  x", "          z  ", " ± ", "before", "coverage", "grade      good: use it"):
        assert word in text
    assert "nan" not in text.lower()


def test_the_installed_command_reads_a_pipe_and_ends_with_its_own_status(sweep: Path) -> None:
    run = [sys.executable, "-m", "server.cli", "calibrate", "mag_ellipsoid"]

    def piped(*args: str, data: bytes) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run([*run, *args], input=data, capture_output=True, check=False, timeout=120)

    whole = sweep.read_bytes()
    fitted = piped("-", "--unit", "raw", "--json", data=whole)
    assert (fitted.returncode, fitted.stderr) == (0, b"")
    assert json.loads(fitted.stdout)["parameters"] == result("mag_ellipsoid", sweep, "--unit", "raw")["parameters"]
    refused = piped("-", "--unit", "raw", "--json", data=whole[:200])
    assert (refused.returncode, refused.stderr) == (3, b"")
    assert json.loads(refused.stdout)["failure"]["code"] == "too-few-samples"
    bad = piped("-", "--json", data=whole)
    assert (bad.returncode, bad.stdout) == (2, b"")
    assert b"column x says no unit" in bad.stderr


def test_the_in_process_command_gives_the_text_and_status_of_the_command_line(sweep: Path) -> None:
    told = Told(kind=CalKind.MAG_ELLIPSOID, files=(sweep,), unit="raw")
    answer = command.run(told, as_json=True)
    assert (answer.status, answer.text + "\n") == navdeck("mag_ellipsoid", sweep, "--unit", "raw", "--json")[:2]


def test_a_known_heading_gives_the_offset_that_was_put_on(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    field_n, _ = wmm_field(47.4, 8.5, 500.0, 2026.9)
    heading, offset = math.radians(130.0), np.array([0.11, -0.07, 0.05])
    c, s = math.cos(heading), math.sin(heading)
    field_b = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ field_n
    imu = np.hstack([rng.normal(0.0, 1e-3, (1000, 3)), rng.normal(0.0, 0.01, (1000, 3)) - [0.0, 0.0, G_M_S2]])
    mag = rng.normal(0.0, 1e-3, (500, 3)) + field_b + offset
    files = (
        write(tmp_path / "imu.csv", IMU_HEADER, imu, stamps_ns(1000, 100.0)),
        write(tmp_path / "mag.csv", "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss", mag, stamps_ns(500, 50.0)),
    )
    place = ("--lat-deg", 47.4, "--lon-deg", 8.5, "--alt-m", 500, "--year", 2026.9)
    found = result("mag_fixed_heading", *files, "--heading-deg", 130, *place)
    np.testing.assert_allclose(found["parameters"]["offset"], offset, atol=2e-3)
    within_3_sigma(found, "offset", offset)
    turned = result("mag_fixed_heading", *files, "--heading-deg", -40, *place)
    assert np.linalg.norm(np.array(turned["parameters"]["offset"]) - offset) > 0.3
    assert result("mag_fixed_heading", *files, *place, status=3)["failure"]["code"] == "heading-unknown"
    part = result("mag_fixed_heading", *files, "--heading-deg", 130, *place, "--ranges", "50:400")
    np.testing.assert_allclose(part["parameters"]["offset"], offset, atol=2e-3)
    assert 300 < part["samples"] <= 350
    earlier = tmp_path / "mag.json"
    soft = [[1.1, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.05]]
    told = {"ok": True, "kind": "mag_ellipsoid", "sigma": {}, "parameters": {"offset": [0, 0, 0], "matrix": soft}}
    earlier.write_text(json.dumps(told))
    bent = write(files[1].with_name("bent.csv"), "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss",
                 mag @ np.linalg.inv(soft).T, stamps_ns(500, 50.0))  # fmt: skip
    again = result("mag_fixed_heading", files[0], bent, "--heading-deg", 130, *place, "--applied", earlier)
    np.testing.assert_allclose(again["parameters"]["offset"], found["parameters"]["offset"], atol=1e-9)
    nowhere = result("mag_fixed_heading", *files, "--heading-deg", 130, status=3)
    assert nowhere["failure"]["code"] == "field-unknown"


def test_the_zero_of_airspeed_and_barometer_is_a_number(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    pitot = write(tmp_path / "pitot.csv", "t_s,diff_pressure_hpa", np.column_stack(
        [np.arange(400) * 0.02, 0.037 + rng.normal(0.0, 0.002, 400)]
    ))  # fmt: skip
    zero = result("airspeed_zero", pitot)
    assert zero["parameters"]["bias"] == pytest.approx(3.7, abs=0.05)
    assert zero["parameters"].keys() == zero["sigma"].keys() == {"bias"}
    assert abs(zero["parameters"]["bias"] - 3.7) < 3.0 * zero["sigma"]["bias"]
    baro = write(tmp_path / "baro.csv", "t_s,altitude_m", np.column_stack(
        [np.arange(400) * 0.1, 431.0 + rng.normal(0.0, 0.05, 400)]
    ))  # fmt: skip
    height = result("baro_reference", baro, "--height-m", 408.5)
    assert height["parameters"]["bias"] == pytest.approx(22.5, abs=0.02)
    climbing = baro.with_name("climb.csv")
    climbing.write_text(baro.read_text() + "".join(f"{40 + 0.1 * k},{431 + k}\n" for k in range(200)))
    assert result("baro_reference", climbing, "--height-m", 408.5, status=3)["failure"]["code"] == "motion"
    part = result("baro_reference", climbing, "--height-m", 408.5, "--ranges", "0:400")
    assert part["parameters"] == height["parameters"]


def test_learning_in_motion_follows_an_offset_that_is_put_on(tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    n, rate_hz = 12000, 100.0
    gyro = np.column_stack([np.sin(0.002 * np.arange(n) * (k + 1.3)) * 1.2 for k in range(3)])
    field, force = np.array([0.21, 0.01, 0.43]), np.array([0.0, 0.0, -G_M_S2])
    q = Rotation.identity()
    body_field, body_force = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        q = q * Rotation.from_rotvec(gyro[k] / rate_hz)
        body_field[k], body_force[k] = q.inv().apply([field, force])
    offset = np.array([0.08, -0.05, 0.1])
    rows = np.hstack([
        gyro + rng.normal(0.0, 2e-3, (n, 3)),
        body_force + rng.normal(0.0, 0.05, (n, 3)),
        body_field + offset + rng.normal(0.0, 2e-3, (n, 3)),
    ])  # fmt: skip
    header = IMU_HEADER + ",mag_x_gauss,mag_y_gauss,mag_z_gauss"
    found = result("mag_in_flight", write(tmp_path / "all.csv", header, rows, stamps_ns(n, rate_hz)))
    np.testing.assert_allclose(found["parameters"]["offset"], offset, atol=0.02)
