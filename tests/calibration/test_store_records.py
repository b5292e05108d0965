"""A set survives JSON bit for bit, and two sets are compared number by number."""

import json
import math
import struct

import numpy as np
import pytest

from server.calibration.diff import diff
from server.calibration.records import CalibrationSet, set_from_fit
from server.calibration.records_json import from_json, to_json
from server.nav.calibration.applied import Calibration
from server.nav.calibration.codes import failure
from server.nav.calibration.types import CalKind, Fit, Sensor
from tests.calibration.store_sets import BOARD, full_set, mag_set


def bits(value):
    return [struct.pack("<d", number) for number in np.asarray(value, dtype=float).ravel().tolist()]


def test_every_float_of_a_set_survives_json_bit_for_bit():
    kept = full_set()
    back = from_json(json.loads(json.dumps(to_json(kept), allow_nan=False)))
    for name, value in kept.parameters.items():
        assert bits(back.parameters[name]) == bits(value)
        assert np.shape(back.parameters[name]) == np.shape(value)
    assert bits(back.sigma["offset"]) == bits(kept.sigma["offset"])
    assert bits([back.coverage, back.residual_after.value]) == bits([math.nan, math.nan])
    same = ("id", "board_id", "sensor", "kind", "grade", "samples", "created_utc", "note", "verified", "samples_file")
    assert [getattr(back, name) for name in same] == [getattr(kept, name) for name in same]
    assert back.verified.failure == kept.verified.failure
    assert to_json(back) == to_json(kept)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sensor", "nose"),
        ("kind", "guess"),
        ("grade", "excellent"),
        ("parameters", {"offset": [1.0, 2.0]}),
        ("parameters", {"offset": ["1", 2.0, 3.0]}),
        ("parameters", None),
        ("note", 3),
        ("coverage", True),
    ],
)
def test_a_field_that_is_not_what_it_should_be_is_refused(field, value):
    with pytest.raises(ValueError, match=r"."):
        from_json({**to_json(full_set()), field: value})


def test_a_missing_field_is_named():
    body = to_json(full_set())
    del body["source"]
    with pytest.raises(ValueError, match="source"):
        from_json(body)


def test_a_gyro_bias_keeps_the_scale_in_force():
    fit = Fit(kind=CalKind.GYRO_BIAS, parameters={"bias": np.ones(3)}, sigma={"bias": np.ones(3)}, grade="good")
    kept = set_from_fit(fit, board_id=BOARD, present=Calibration(gyro_matrix=np.diag([1.5] * 3)), source="job")
    assert kept.sensor is Sensor.GYRO
    assert kept.parameters["scale"].tolist() == [1.5] * 3
    assert (kept.parameters["bias"].tolist(), kept.source) == ([1.0] * 3, "job")


def test_a_refused_fit_makes_no_set():
    with pytest.raises(ValueError, match="refused"):
        set_from_fit(Fit(kind=CalKind.LEVEL, failure=failure("motion")), board_id=BOARD, present=Calibration())


def test_a_diff_gives_change_and_change_in_standard_deviations():
    rows = {row.name: row for row in diff(mag_set(0.1), mag_set(0.4))}
    first = rows["offset[0]"]
    assert (first.old, first.new, first.unit) == (0.1, 0.4, "gauss")
    assert first.change == pytest.approx(0.3)
    assert first.sigma == pytest.approx(0.001 * math.sqrt(2))
    assert first.change_in_sigma == pytest.approx(0.3 / 0.001 / math.sqrt(2))
    assert rows["offset[1]"].change == 0.0
    assert rows["matrix[0][0]"].unit == ""
    assert math.isnan(rows["matrix[0][0]"].change_in_sigma)
    assert len(rows) == 12


def test_a_diff_with_nothing_in_force_starts_from_the_identity():
    rows = {row.name: row for row in diff(None, mag_set(0.4))}
    assert (rows["offset[0]"].old, rows["matrix[0][0]"].old, rows["matrix[0][1]"].old) == (0.0, 1.0, 0.0)
    assert rows["offset[0]"].change_in_sigma == pytest.approx(400.0)


def test_sets_of_two_sensors_are_not_compared():
    bare = CalibrationSet(board_id=BOARD, sensor=Sensor.BARO, kind="import", parameters={"bias": 1.0})
    with pytest.raises(ValueError, match="baro"):
        diff(mag_set(), bare)


def test_a_gyro_with_cross_axis_terms_is_compared_as_a_matrix():
    plain = CalibrationSet(board_id=BOARD, sensor=Sensor.GYRO, kind="import", parameters={"scale": np.full(3, 2.0)})
    full = CalibrationSet(
        board_id=BOARD, sensor=Sensor.GYRO, kind="import", parameters={"matrix": np.full((3, 3), 3.0)}
    )
    rows = {row.name: (row.old, row.new) for row in diff(plain, full)}
    assert rows["matrix[0][0]"] == (2.0, 3.0)
    assert rows["matrix[0][1]"] == (0.0, 3.0)
