"""Exported parameters, put through the autopilot's own formula, do what our calibration does to what it sends."""

import numpy as np
import pytest

from server.calibration.errors import ExchangeError
from server.calibration.exchange import export_calibration, import_calibration, read_parameters
from server.calibration.exchange.affine import board_rotation
from server.nav.calibration.types import Sensor
from tests.calibration import exchange_laws as laws
from tests.calibration.exchange_laws import (
    ACCEL,
    ACCEL_CROSS,
    AIRSPEED,
    BARO,
    COMMON,
    GYRO,
    GYRO_SCALED,
    LEVEL,
    MAG,
    calibration,
    in_force,
)

RAW = np.random.default_rng(4).normal(size=(50, 3))
ARDUPILOT_BOARD = {
    "INS_ACCOFFS_X": 0.11, "INS_ACCOFFS_Y": -0.2, "INS_ACCOFFS_Z": 0.05,
    "INS_ACCSCAL_X": 1.01, "INS_ACCSCAL_Y": 0.98, "INS_ACCSCAL_Z": 1.003,
    "INS_GYROFFS_X": 0.01, "INS_GYROFFS_Y": -0.02, "INS_GYROFFS_Z": 0.005,
    "COMPASS_OFS_X": 172.0, "COMPASS_OFS_Y": -19.0, "COMPASS_OFS_Z": -153.0, "COMPASS_SCALE": 1.07,
    "AHRS_ORIENTATION": 10.0, "AHRS_TRIM_X": 0.3, "ARSPD_OFFSET": 40.0, "BARO_ALT_OFFSET": 1.0,
}  # fmt: skip
PX4_BOARD = {
    "CAL_ACC0_XOFF": 0.11, "CAL_ACC0_YOFF": -0.2, "CAL_ACC0_ZOFF": 0.05,
    "CAL_ACC0_XSCALE": 1.01, "CAL_ACC0_YSCALE": 0.98, "CAL_ACC0_ZSCALE": 1.003,
    "CAL_GYRO0_XOFF": 0.01, "CAL_GYRO0_YOFF": -0.02, "CAL_GYRO0_ZOFF": 0.005,
    "CAL_MAG0_XOFF": 0.3, "CAL_MAG0_YOFF": -0.1, "CAL_MAG0_ZOFF": 0.05,
    "CAL_MAG0_ROT": -1.0, "SENS_BOARD_ROT": 4.0,
}  # fmt: skip
ROLL_180_YAW_90 = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # 10: y, x, −z
YAW_180 = np.diag([-1.0, -1.0, 1.0])


def exported(form, sets, board=None):
    """The parameters as the board reads them from the text, and the warnings."""
    out = export_calibration(form, sets, board=board, **COMMON)
    return read_parameters(out.text), out.warnings


def codes(warnings):
    return {warning.code for warning in warnings}


@pytest.mark.parametrize("board", [None, {}])
def test_ardupilot_does_what_we_did_when_it_did_nothing_before(board):
    sets = in_force(MAG, ACCEL, GYRO, LEVEL, AIRSPEED, BARO)
    parameters, _ = exported("ardupilot", sets, board)
    whole, eye = calibration(sets), np.eye(3)
    mag = laws.ardupilot_mag(parameters, 1000 * RAW) / 1000
    np.testing.assert_allclose(mag, (RAW - whole.mag_offset) @ whole.mag_matrix.T, atol=1e-6)
    accel = laws.ardupilot_accel(parameters, RAW, eye)
    np.testing.assert_allclose(accel, (RAW - whole.accel_offset) @ whole.accel_matrix.T, atol=1e-6)
    np.testing.assert_allclose(laws.ardupilot_gyro(parameters, RAW, eye), RAW - whole.gyro_offset, atol=1e-7)
    trim = laws.dcm(parameters["AHRS_TRIM_X"], parameters["AHRS_TRIM_Y"], 0.0)
    np.testing.assert_allclose(trim, whole.level, atol=1e-8)
    assert (parameters["ARSPD_OFFSET"], parameters["BARO_ALT_OFFSET"]) == (12.5, -3.25)


def test_the_offset_of_a_compass_has_the_other_sign_in_milligauss():
    parameters, _ = exported("ardupilot", in_force(MAG))
    assert laws.three(parameters, "COMPASS_OFS_?") == pytest.approx([-120.0, 310.0, -50.0])


def test_ardupilot_s_parameters_are_composed_with_what_it_applies_already():
    sets = in_force(ACCEL, GYRO, LEVEL, AIRSPEED, BARO, laws.a_set(Sensor.MAG, offset=[0.1, 0.2, -0.3]))
    parameters, _ = exported("ardupilot", sets, ARDUPILOT_BOARD)
    now, then, R = ARDUPILOT_BOARD, {**ARDUPILOT_BOARD, **parameters}, ROLL_180_YAW_90
    whole = calibration(sets)
    sent = laws.ardupilot_accel(now, RAW, R)
    wanted = (sent - whole.accel_offset) @ whole.accel_matrix.T
    np.testing.assert_allclose(laws.ardupilot_accel(then, RAW, R), wanted, atol=1e-6)
    wanted = laws.ardupilot_gyro(now, RAW, R) - whole.gyro_offset
    np.testing.assert_allclose(laws.ardupilot_gyro(then, RAW, R), wanted, atol=1e-7)
    wanted = laws.ardupilot_mag(now, 1000 * RAW) - 1000 * whole.mag_offset
    np.testing.assert_allclose(laws.ardupilot_mag(then, 1000 * RAW), wanted, atol=1e-3)
    assert parameters["AHRS_TRIM_X"] == pytest.approx(0.02)  # the trim is not in what the board sends
    assert (parameters["ARSPD_OFFSET"], parameters["BARO_ALT_OFFSET"]) == (52.5, -2.25)


def test_px4_s_parameters_are_composed_with_what_it_applies_already():
    board = {**PX4_BOARD, "SENS_BOARD_X_OFF": 1.5, "SENS_BOARD_Y_OFF": -2.0}
    scalar = np.diag([1.05] * 3)  # a scale that no rotation turns into cross-axis terms
    sets = in_force(
        laws.a_set(Sensor.ACCEL, offset=[0.2, -0.4, 0.31], matrix=scalar),
        laws.a_set(Sensor.MAG, offset=[0.12, -0.31, 0.05], matrix=MAG.parameters["matrix"]),
        GYRO,
        LEVEL,
        AIRSPEED,
    )
    parameters, warnings = exported("px4", sets, board)
    then, whole = {**board, **parameters}, calibration(sets)
    for name, law in (("accel", laws.px4_accel), ("gyro", laws.px4_gyro), ("mag", laws.px4_mag)):
        matrix, offset = getattr(whole, f"{name}_matrix"), getattr(whole, f"{name}_offset")
        wanted = (law(board, RAW, YAW_180) - offset) @ (whole.level @ matrix).T
        np.testing.assert_allclose(law(then, RAW, YAW_180), wanted, atol=2e-6, err_msg=name)
    assert parameters["SENS_DPRES_OFF"] == 12.5
    assert codes(warnings) == set()


def test_px4_does_what_we_did_when_it_did_nothing_before():
    sets = in_force(MAG, ACCEL, GYRO, LEVEL)
    parameters, warnings = exported("px4", sets)
    whole = calibration(sets)
    for name, law in (("accel", laws.px4_accel), ("gyro", laws.px4_gyro), ("mag", laws.px4_mag)):
        matrix, offset = getattr(whole, f"{name}_matrix"), getattr(whole, f"{name}_offset")
        wanted = (RAW - offset) @ (whole.level @ matrix).T
        np.testing.assert_allclose(law(parameters, RAW, np.eye(3)), wanted, atol=1e-6, err_msg=name)
    assert codes(warnings) == {"board-unknown"}


@pytest.mark.parametrize("form", ["ardupilot", "px4"])
def test_what_a_format_cannot_hold_is_said_with_its_size(form):
    out = export_calibration(form, in_force(ACCEL_CROSS, GYRO_SCALED), board={}, **COMMON)
    by_code = {warning.code: warning for warning in out.warnings}
    assert by_code["cross-axis-lost"].size == pytest.approx(0.0143 * 9.80665, rel=1e-6)
    assert by_code["cross-axis-lost"].unit == "m/s²"
    assert by_code["scale-lost"].size == pytest.approx(0.02)
    assert "Cross-axis" in out.text
    parameters = read_parameters(out.text)
    law = laws.ardupilot_accel if form == "ardupilot" else laws.px4_accel
    at_zero = law(parameters, ACCEL_CROSS.parameters["offset"], np.eye(3))
    np.testing.assert_allclose(at_zero, 0.0, atol=1e-7)  # the offset itself is not lost


def test_a_magnetometer_s_turn_against_the_board_is_said():
    turned = laws.a_set(Sensor.MAG, matrix=laws.dcm(0.0, 0.0, 0.05))
    _, warnings = exported("ardupilot", in_force(turned), {})
    (lost,) = [warning for warning in warnings if warning.code == "cross-axis-lost"]
    assert lost.size == pytest.approx(np.sin(0.05))


def test_without_the_board_s_parameters_the_file_says_so_at_its_top():
    text = export_calibration("ardupilot", in_force(MAG), **COMMON).text
    first_parameter = text.index("COMPASS")
    assert 0 < text.index("own parameters were not given") < first_parameter
    composed = export_calibration("ardupilot", in_force(MAG), board={}, **COMMON).text
    assert "own parameters were not given" not in composed


def test_values_an_autopilot_refuses_are_named():
    far = laws.a_set(Sensor.ACCEL, offset=[5.0, 0.0, 0.0])
    _, warnings = exported("ardupilot", in_force(far), {})
    assert [warning.size for warning in warnings if warning.code == "out-of-range"] == [5.0]


def test_only_sensors_with_a_calibration_are_written():
    parameters, _ = exported("ardupilot", in_force(AIRSPEED), {})
    assert set(parameters) == {"ARSPD_OFFSET"}


def test_a_custom_rotation_leaves_the_inertial_sensors_out_and_says_so():
    board = {"AHRS_ORIENTATION": 101.0}
    parameters, warnings = exported("ardupilot", in_force(ACCEL, GYRO, AIRSPEED), board)
    assert set(parameters) == {"ARSPD_OFFSET"}
    assert {warning.sensor for warning in warnings if warning.code == "orientation-unknown"} == {
        Sensor.ACCEL,
        Sensor.GYRO,
    }


@pytest.mark.parametrize(
    ("number", "expected"),
    [  # AP_Math/vector3.cpp, `rotate`, and vectors.cpp of the same name: what becomes of (x, y, z)
        (0, (1, 2, 3)),
        (2, (-2, 1, 3)),
        (4, (-1, -2, 3)),
        (6, (2, -1, 3)),
        (8, (1, -2, -3)),
        (10, (2, 1, -3)),
        (12, (-1, 2, -3)),
        (16, (1, -3, 2)),
        (20, (1, 3, -2)),
        (24, (3, 2, -1)),
        (25, (-3, 2, 1)),
        (37, (-3, -1, 2)),
    ],
)
def test_the_fixed_rotations_are_the_autopilots_own(number, expected):
    np.testing.assert_allclose(np.dot(board_rotation(number), [1.0, 2.0, 3.0]), expected, atol=1e-12)


def test_every_fixed_rotation_is_what_mavlink_says():
    from pymavlink.dialects.v20 import common

    for number in range(38):
        words = common.enums["MAV_SENSOR_ORIENTATION"][number].description.replace(",", "").split()
        roll, pitch, yaw = np.radians([float(words[k]) for k in (1, 3, 5)])
        np.testing.assert_allclose(board_rotation(number), laws.dcm(roll, pitch, yaw), atol=1e-12)
    assert board_rotation(38) is None
    assert board_rotation(1.5) is None


# --- reading ------------------------------------------------------------------------------------


def imported(text, board=None):
    return import_calibration(
        text, name="my.param", board_id="b", created_by="operator", software_version="0.1.0", board=board
    )


@pytest.mark.parametrize(("form", "board"), [("ardupilot", ARDUPILOT_BOARD), ("px4", PX4_BOARD)])
@pytest.mark.parametrize("with_board", [True, False])
def test_what_was_exported_is_imported_to_the_same_correction(form, board, with_board):
    known = board if with_board else None
    sets = in_force(MAG, ACCEL, GYRO, LEVEL, AIRSPEED)
    if with_board:  # a scale of one axis stays one of an axis under this board's rotation
        sets[Sensor.MAG] = laws.a_set(Sensor.MAG, offset=[0.1, 0.2, -0.3], matrix=np.eye(3) * 1.1)
    out = export_calibration(form, sets, board=known, **COMMON)
    back = imported(out.text, known)
    assert back.form == form
    assert {kept.sensor for kept in back.sets} == set(sets)
    want, got = calibration(sets), calibration(in_force(*back.sets))
    np.testing.assert_allclose(got.flat(), want.flat(), atol=1e-6)
    one = back.sets[0]
    assert (one.board_id, one.kind, one.source, one.created_by) == ("b", "import", f"import:{form}", "operator")


def test_the_board_s_own_file_changes_nothing_but_the_trim():
    text = "\n".join(f"{name},{value}" for name, value in ARDUPILOT_BOARD.items())
    back = imported(text, ARDUPILOT_BOARD)
    assert {kept.sensor for kept in back.sets} == {Sensor.BOARD}
    assert codes(back.warnings) == {"nothing-to-do"}


def test_the_logged_offsets_of_a_compass_become_ours_with_the_other_sign():
    back = imported("COMPASS_OFS_X,172\nCOMPASS_OFS_Y,-19\nCOMPASS_OFS_Z,-153\n")
    (kept,) = back.sets
    assert kept.parameters["offset"] == pytest.approx([-0.172, 0.019, 0.153])
    assert codes(back.warnings) == {"board-unknown"}


@pytest.mark.parametrize(
    "text",
    [
        "# a comment\nINS_GYROFFS_X,0.25\n",
        "INS_GYROFFS_X 0.25 # why\r\n",
        "INS_GYROFFS_X\t0.25\n",
        "\ufeff1\t1\tINS_GYROFFS_X\t0.25\t9\n",
        "INS_GYROFFS_X=0.25",
    ],
)
def test_every_common_form_of_a_parameter_file_is_read(text):
    assert read_parameters(text) == {"INS_GYROFFS_X": 0.25}


@pytest.mark.parametrize(
    "text", ["", "# nothing\n", "hello world\n", "INS_GYROFFS_X,nan\n", "INS_GYROFFS_X\n", "x,1\n"]
)
def test_what_is_no_parameter_file_is_refused_with_its_line(text):
    with pytest.raises(ExchangeError, match=r"Line 1|no parameter"):
        read_parameters(text)


def test_a_file_without_calibration_is_refused():
    with pytest.raises(ExchangeError, match="no calibration"):
        imported("RC1_MIN,1000\n")


def test_a_height_bias_that_px4_cannot_hold_is_said():
    parameters = export_calibration("px4", in_force(BARO, AIRSPEED), board={}, **COMMON)
    (lost,) = parameters.warnings
    assert (lost.code, lost.size, lost.unit) == ("baro-lost", 3.25, "m")
