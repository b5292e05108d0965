"""Tables without time as others publish them: a row a pose, a handful of rows a pose, a slow log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from server.calibrate.jumps import ranges_by_jumps
from tests.calibrate.cal_files import G_M_S2, S0_ACCEL_OFFSET, S0_T, Rows, sphere, write
from tests.calibrate.test_command import navdeck, result

UP = np.array([[0, 0, 1], [1, 0, 0], [0, -1, 0], [-1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
NAMES = "accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"


def raw_of(force: Rows, noise: float = 0.003, seed: int = 0) -> Rows:
    """Return what S0's sensor reads."""
    read = force @ np.linalg.inv(S0_T).T + S0_ACCEL_OFFSET
    return np.asarray(read + np.random.default_rng(seed).normal(0.0, noise, force.shape))


def close(found: dict[str, object], counts: float = 1.0, atol: float = 0.006) -> None:
    """The offset is right to a thousandth of g and the matrix to 0.6 %."""
    parameters = found["parameters"]
    assert isinstance(parameters, dict)
    np.testing.assert_allclose(np.array(parameters["offset"]) / counts, S0_ACCEL_OFFSET, atol=0.02)
    np.testing.assert_allclose(np.array(parameters["matrix"]) * counts, S0_T, atol=atol)


@pytest.mark.parametrize("rows", [1, 2, 5, 20, 60])
@pytest.mark.parametrize("unit", ["si", "raw"])
def test_a_handful_of_rows_a_face_is_six_positions_with_and_without_ranges(
    tmp_path: Path, rows: int, unit: str
) -> None:
    counts = 16384.0 / G_M_S2 if unit == "raw" else 1.0
    table = raw_of(np.repeat(G_M_S2 * UP, rows, axis=0)) * counts
    path = write(
        tmp_path / "faces.csv", "x,y,z" if unit == "raw" else NAMES, np.rint(table) if unit == "raw" else table
    )
    args = (path, *(("--unit", "raw") if unit == "raw" else ()))
    ranges = ",".join(f"{a}:{a + rows}" for a in range(0, 6 * rows, rows))
    told, found = result("accel_six_position", *args, "--ranges", ranges), result("accel_six_position", *args)
    close(told, counts)
    close(found, counts)
    assert told["notes"] == []
    assert len(found["notes"]) == 1
    assert found["notes"][0].startswith("No time column")
    if rows == 1:
        assert told["sigma"]["offset"] == [None, None, None]


def test_a_row_a_pose_is_a_multi_pose_set_and_a_plane_of_them_is_refused(tmp_path: Path) -> None:
    everywhere = write(tmp_path / "poses.csv", NAMES, raw_of(G_M_S2 * sphere(24)))
    found = result("accel_multi_pose", everywhere)
    length = np.linalg.norm(
        (raw_of(G_M_S2 * sphere(24)) - found["parameters"]["offset"]) @ np.array(found["parameters"]["matrix"]).T,
        axis=1,
    )
    assert np.abs(length - G_M_S2).max() < 0.02
    assert found["details"]["poses"] == 24.0
    angle = np.arange(16) / 16.0 * 2.0 * np.pi
    plane = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(16)])
    flat = result("accel_multi_pose", write(tmp_path / "flat.csv", NAMES, raw_of(G_M_S2 * plane)), status=3)
    assert flat["failure"]["code"] == "poses-alike"
    five = result("accel_six_position", write(tmp_path / "five.csv", NAMES, raw_of(G_M_S2 * UP[:5])), status=3)
    assert (five["failure"]["code"], five["failure"]["measured"]) == ("pose-missing", 5.0)


def test_a_slow_log_without_time_is_read_slower_and_it_is_said(tmp_path: Path) -> None:
    """Forty samples a face, as 10 Hz for 4 s, with a second of turning between."""
    rng, parts = np.random.default_rng(3), []
    for k, up in enumerate(UP):
        parts.append(np.tile(up, (40, 1)))
        share = np.linspace(0.0, 1.0, 12)[1:-1, None]
        between = (1.0 - share) * up + share * UP[(k + 1) % 6] + 0.4 * np.sin(np.pi * share)
        parts.append(between / np.linalg.norm(between, axis=1, keepdims=True) + rng.normal(0.0, 0.1, (10, 3)))
    path = write(tmp_path / "slow.csv", NAMES, raw_of(G_M_S2 * np.vstack(parts), 0.01))
    found = result("accel_six_position", path)
    close(found)
    assert any("10 a second are assumed" in note for note in found["notes"])
    close(result("accel_six_position", path, "--rate-hz", 10))
    assert result("accel_six_position", path, "--rate-hz", 100, status=3)["failure"]["code"] == "too-few-samples"


def test_a_fixed_heading_in_counts_needs_the_strength_in_counts(tmp_path: Path) -> None:
    """A board level with its nose north reads the field itself and its offset; here in thousandths of a gauss."""
    rng = np.random.default_rng(4)
    field, offset = np.array([0.2, 0.01, 0.44]), np.array([0.1, -0.05, 0.08])
    rows = np.hstack(
        [
            1e3 * (field + offset + rng.normal(0.0, 0.002, (600, 3))),
            np.array([0.0, 0.0, -G_M_S2]) + rng.normal(0.0, 0.02, (600, 3)),
            rng.normal(0.0, 0.002, (600, 3)),
        ]
    )
    path = write(tmp_path / "stood.csv", f"mx,my,mz,{NAMES},gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s", rows)
    args = ("mag_fixed_heading", path, "--unit", "raw", "--heading-deg", 0, "--lat-deg", 48, "--lon-deg", 11)
    code, out, err = navdeck(*args)
    assert (code, out) == (2, "")
    assert "strength must be given" in err
    weak = result(*args, "--strength", 484)
    twice = result(*args, "--strength", 968)
    assert weak["residual_before"]["unit"] == "counts"
    step = np.array(weak["parameters"]["offset"]) - twice["parameters"]["offset"]  # the field once more
    assert np.linalg.norm(step) == pytest.approx(484.0, rel=1e-6)


@pytest.mark.parametrize(("rate_hz", "hold"), [(1.0, 10), (5.0, 20), (10.0, 20)])
def test_a_slow_log_with_stamps_gives_its_faces_the_last_one_too(tmp_path: Path, rate_hz: float, hold: int) -> None:
    """Two seconds or a few samples a face, and the file ends with the last one."""
    rng, parts = np.random.default_rng(5), []
    for k, up in enumerate(UP):
        share = np.linspace(0.0, 1.0, 6)[1:-1, None]
        turning = (1.0 - share) * up + share * UP[(k + 1) % 6]
        parts += [np.tile(up, (hold, 1)), turning / np.linalg.norm(turning, axis=1, keepdims=True)]
    rows = raw_of(G_M_S2 * np.vstack(parts[:-1]), 0.01)
    t_s = (np.arange(len(rows)) + rng.uniform(0.0, 0.1, len(rows))) / rate_hz
    close(result("accel_six_position", write(tmp_path / "log.csv", f"t_s,{NAMES}", np.column_stack([t_s, rows]))))


def test_jumps_leave_out_what_was_read_on_the_way_and_a_stream_is_none() -> None:
    poses = np.repeat(UP, 9, axis=0)
    on_the_way = np.insert(poses, [9, 9, 18], [[0.5, 0.5, 0.7], [0.7, 0.7, 0.1], [0.8, -0.6, 0.0]], axis=0)
    assert ranges_by_jumps(poses) == tuple((a, a + 9) for a in range(0, 54, 9))
    assert [b - a for a, b in ranges_by_jumps(on_the_way)] == [9] * 6
    assert ranges_by_jumps(np.repeat(UP, 500, axis=0)) == ()
    smooth = np.column_stack([np.cos(np.linspace(0, 9, 200)), np.sin(np.linspace(0, 9, 200)), np.zeros(200)])
    assert ranges_by_jumps(smooth) == ()
    assert ranges_by_jumps(UP[:3]) == ()
