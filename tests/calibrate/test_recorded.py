"""Recordings with published or independently computed results, as files a person would give the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.calibrate.test_command import result

Matrix = NDArray[np.float64]


def same_shape(found: Matrix, published: Matrix) -> float:
    """Return the largest difference of two matrices, of the largest entry, each made of unit determinant."""
    a, b = (m / np.cbrt(np.linalg.det(m)) for m in (found, published))
    return float(np.abs(a - b).max() / np.abs(b).max())


def test_the_sweep_with_a_published_fit_gives_its_hard_and_soft_iron(shared_data: Path) -> None:
    folder = shared_data / "mag_ellipsoid"
    found = result("mag_ellipsoid", folder / "jremington_mag3_raw.csv", "--unit", "raw")
    text = (folder / "jremington_mag3_out.txt").read_text()
    numbers = [
        [float(v) for v in line.replace("[", " ").replace("]", " ").split()]
        for line in text.splitlines()[2:9]
        if "[" in line
    ]
    published, centre = np.array(numbers[:3]), np.array(numbers[3:6]).ravel()
    radius = 1000.0 / np.cbrt(np.linalg.det(published))
    assert np.abs(np.array(found["parameters"]["offset"]) - centre).max() < 0.01 * radius
    assert same_shape(np.array(found["parameters"]["matrix"]), published) < 0.01
    assert any("no header" in note for note in found["notes"])


@pytest.mark.parametrize("unit", ["--unit raw", "mag_{}_ut", "mag_{}_nt", "mag_{}_gauss"])
def test_a_sweep_in_microtesla_gives_the_same_in_every_unit_and_way_to_write_it(
    shared_data: Path, tmp_path: Path, unit: str
) -> None:
    source = shared_data / "mag_ellipsoid" / "michaelwro_mag-readings.txt"
    raw = result("mag_ellipsoid", source, "--unit", "raw")
    factor = {"mag_{}_ut": 1.0, "mag_{}_nt": 1e3, "mag_{}_gauss": 1e-2}.get(unit, 1.0)
    assert np.abs(np.array(raw["parameters"]["offset"]) - [28.9, -41.2, -27.7]).max() < 1.5
    if unit.startswith("--"):
        header, args = "x\ty\tz", unit.split()
    else:
        header, args = "\t".join(unit.format(axis) for axis in "xyz"), []
    lines = [
        header,
        *("\t".join(repr(float(v) * factor) for v in line.split()) for line in source.read_text().splitlines()),
    ]
    path = tmp_path / "sweep.tsv"
    path.write_text("\n".join(lines))
    found = result("mag_ellipsoid", path, *args)
    gauss = 1.0 if args else 1e-2
    np.testing.assert_allclose(found["parameters"]["offset"], np.array(raw["parameters"]["offset"]) * gauss, rtol=1e-6)
    np.testing.assert_allclose(
        found["parameters"]["matrix"],
        np.array(raw["parameters"]["matrix"]) / gauss,
        rtol=1e-6,
        atol=1e-6 * 0.02 / gauss,
    )
    assert found["coverage"] == pytest.approx(raw["coverage"])


def ferraris(shared_data: Path) -> tuple[Path, Path, dict[str, Matrix]]:
    """Return the session, its stretches, and the mean of each stretch by plain arithmetic (gyro °/s, acc m/s²)."""
    folder = shared_data / "imucal_ferraris"
    session, stretches = folder / "example_ferraris_session.csv", folder / "example_ferraris_session_list.json"
    table = np.loadtxt(session, delimiter=",", skiprows=1)[:, 1:]
    named = json.loads(stretches.read_text())
    return session, stretches, {name: table[s["start"] : s["end"]].mean(axis=0) for name, s in named.items()}


def test_a_ferraris_session_gives_the_six_position_result_with_and_without_its_stretches(shared_data: Path) -> None:
    session, stretches, means = ferraris(shared_data)
    told = result("accel_six_position", session, "--unit", "si", "--ranges", stretches)
    found = result("accel_six_position", session, "--unit", "si", "--rate-hz", 102.4)
    pairs = [(means[f"{axis}_p"][3:], means[f"{axis}_a"][3:]) for axis in "xyz"]
    offset = [(up[k] + down[k]) / 2.0 for k, (up, down) in enumerate(pairs)]  # S0 eq. 3.5
    poses = np.array([pose for pair in pairs for pose in pair])
    for one in (told, found):
        assert np.abs(np.array(one["parameters"]["offset"]) - offset).max() < 0.01 * 9.81
        matrix = np.array(one["parameters"]["matrix"])
        calibrated = (poses - one["parameters"]["offset"]) @ matrix.T
        assert np.abs(np.linalg.norm(calibrated, axis=1) - 9.80665).max() < 0.1
        assert one["residual_after"]["value"] < 0.1 < one["residual_before"]["value"]
    np.testing.assert_allclose(told["parameters"]["matrix"], found["parameters"]["matrix"], atol=0.01)


def test_a_ferraris_session_has_the_gyro_s_bias_in_degrees(shared_data: Path) -> None:
    session, stretches, means = ferraris(shared_data)
    first = json.loads(stretches.read_text())["x_p"]
    found = result("gyro_bias", session, "--unit", "raw", "--ranges", f"{first['start']}:{first['end']}")
    np.testing.assert_allclose(found["parameters"]["bias"], means["x_p"][:3], atol=0.02)


def test_raw_counts_of_many_poses_give_a_length_of_gravity_in_every_still_second(shared_data: Path) -> None:
    path = shared_data / "imu_tk_xsens" / "xsens_acc.mat"
    args = ("--unit", "raw", "--columns", "t_s,x,y,z", "--gravity", 9.81744)
    found = result("accel_multi_pose", path, *args)
    counts = np.loadtxt(path)[:, 1:]
    windows = counts[: len(counts) // 100 * 100].reshape(-1, 100, 3)
    still = windows[windows.std(axis=1).max(axis=1) < 12.0].mean(axis=1)
    assert len(still) > 150
    calibrated = (still - found["parameters"]["offset"]) @ np.array(found["parameters"]["matrix"]).T
    error = np.linalg.norm(calibrated, axis=1) - 9.81744
    assert float(np.sqrt(np.mean(error**2))) < 0.02
    assert np.abs(np.array(found["parameters"]["offset"]) - 32768.0).max() < 0.15 * 4100.0  # the nominal zero


def test_a_board_at_rest_in_a_tlog_has_its_bias_and_level(shared_data: Path) -> None:
    path = shared_data / "ardupilot_sitl" / "static.tlog"
    bias = result("gyro_bias", path)
    assert np.abs(bias["parameters"]["bias"]).max() < 0.002  # a simulated gyro: its drift is all there is
    level = result("level", path)
    assert level["grade"] == "good"
    rotation = np.array(level["parameters"]["matrix"])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    six = result("accel_six_position", path, status=3)
    assert six["failure"]["code"] == "pose-missing"
    spin = result("mag_ellipsoid", path, status=3)
    assert spin["failure"]["code"] in {"coverage-poor", "coverage-planar", "too-few-samples"}


def test_a_ferraris_session_s_turns_give_the_scale_of_the_plain_integral_in_counts_and_in_degrees(
    shared_data: Path, tmp_path: Path
) -> None:
    session, stretches, means = ferraris(shared_data)
    table = np.loadtxt(session, delimiter=",", skiprows=1)[:, 1:4]
    named = json.loads(stretches.read_text())
    rest_deg_s = means["z_a"][:3]
    expected = []
    for k, axis in enumerate("xyz"):
        turn = named[f"{axis}_rot"]
        angle_deg = (table[turn["start"] : turn["end"], k] - rest_deg_s[k]).sum() / 102.4
        expected.append(360.0 / abs(angle_deg))  # S1 eq. 3.10, 3.11
    degrees = tmp_path / "degrees.csv"
    rest = session.read_text().split("\n", 1)[1]
    degrees.write_text("n_samples,gyr_x_deg_s,gyr_y_deg_s,gyr_z_deg_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2\n" + rest)
    args = ("--rate-hz", 102.4, "--ranges", stretches)
    si = result("gyro_scale", degrees, *args)
    np.testing.assert_allclose(si["parameters"]["scale"], expected, rtol=5e-3)
    np.testing.assert_allclose(si["parameters"]["bias"], np.radians(rest_deg_s), atol=np.radians(0.05))
    raw = result("gyro_scale", session, "--unit", "raw", "--turns", 1, *args)
    np.testing.assert_allclose(raw["parameters"]["scale"], np.radians(si["parameters"]["scale"]), rtol=1e-6)
    one = result("gyro_scale", degrees, "--axis", "y", *args)
    assert one["parameters"]["scale"][0] == one["parameters"]["scale"][2] == 1.0
    assert one["sigma"]["scale"][0] is None
    assert one["parameters"]["scale"][1] == pytest.approx(expected[1], rel=5e-3)
