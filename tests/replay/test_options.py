"""Options as text."""

from __future__ import annotations

import pytest

from server.nav.lanes.registry import RECORDED_LANES as LANES
from server.nav.lanes.registry import parameters_of
from server.replay.errors import ReplayError
from server.replay.options import (
    chain_from_texts,
    checked_outage,
    lanes_from_text,
    learning_from_text,
    merged,
    outage_from_text,
    values_from_texts,
)


def test_lanes_are_named_or_all() -> None:
    assert lanes_from_text("all") == lanes_from_text("") == LANES
    assert lanes_from_text(" reference, ins_ekf,reference ") == ("reference", "ins_ekf")


def test_an_unknown_lane_is_answered_with_those_there_are() -> None:
    with pytest.raises(ReplayError, match=r"lane 'ins_efk' is not known \(did you mean ins_ekf\?\). Known: ins_ekf, "):
        lanes_from_text("reference,ins_efk")


def test_an_outage_is_two_numbers_of_seconds() -> None:
    assert outage_from_text("60:90.5") == (60.0, 90.5)
    assert outage_from_text("0:1e3") == (0.0, 1000.0)


@pytest.mark.parametrize("text", ["60", "a:b", "60:", "1:2:3", ""])
def test_an_outage_that_is_not_two_numbers_says_how_to_write_it(text: str) -> None:
    with pytest.raises(ReplayError, match="Write for example 60:90"):
        outage_from_text(text)


@pytest.mark.parametrize("stretch", [(5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (0.0, float("inf")), (float("nan"), 1.0)])
def test_an_outage_that_is_no_stretch_is_refused(stretch: tuple[float, float]) -> None:
    with pytest.raises(ReplayError, match="0 ≤ A < B"):
        checked_outage(stretch)


def test_a_parameter_is_lane_dot_name_equals_value_and_the_last_wins() -> None:
    lane, one = next((lane, one) for lane in LANES for one in parameters_of(lane))
    texts = [f"{lane}.{one.name}={one.minimum!r}", f" {lane} . {one.name} = {one.maximum!r} "]
    assert values_from_texts(texts) == {lane: {one.name: one.maximum}}
    assert values_from_texts([]) == {}


@pytest.mark.parametrize(
    "text", ["", "ins_ekf", "ins_ekf.x", "x=1", ".x=1", "ins_ekf.=1", "ins_ekf.x=", "ins_ekf.x=nan"]
)
def test_a_parameter_that_is_not_of_that_form_says_how_to_write_it(text: str) -> None:
    with pytest.raises(ReplayError, match=r"LANE\.PARAMETER=VALUE|not a finite number"):
        values_from_texts([text])


def test_preprocessing_is_sensor_dot_parameter_equals_value_as_in_the_setting() -> None:
    assert chain_from_texts(["imu.butterworth_hz=40", "gyro.butterworth_hz = 30", "board.mounting=yaw90"]) == {
        "gyro": {"butterworth_hz": 30.0, "roll_deg": 0.0, "pitch_deg": 0.0, "yaw_deg": 90.0},
        "accel": {"butterworth_hz": 40.0, "roll_deg": 0.0, "pitch_deg": 0.0, "yaw_deg": 90.0},
        "mag": {"roll_deg": 0.0, "pitch_deg": 0.0, "yaw_deg": 90.0},
    }
    assert chain_from_texts([]) == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("gyro", r"'gyro' is not SENSOR\.PARAMETER=VALUE, as in gyro\.butterworth_hz=40"),
        ("butterworth_hz=40", r"is not SENSOR\.PARAMETER=VALUE"),
        ("gyro.butterworth_hz=", r"is not SENSOR\.PARAMETER=VALUE"),
        ("gyro.butterworth_hz=soon", "'soon' is not a finite number"),
        ("gyro.butterworth_hz=-1", r"gyro\.butterworth_hz = -1 Hz is outside 0 … 4000 Hz; the default is 0"),
        ("gyro.window_samples=2.5", "2.5 is not a whole number"),
        ("gyro.cutoff=1", "the chain of gyro has no parameter cutoff; there are: zero_x_counts"),
        ("gps.window_samples=2", "no chain of gps; there are: gyro, accel, mag, baro, airspeed"),
        ("board.mounting=sideways", "'sideways' is no mounting; take none, or roll"),
    ],
)
def test_preprocessing_that_cannot_be_is_refused_with_value_limit_and_remedy(text: str, says: str) -> None:
    with pytest.raises(ReplayError, match=f"--preprocess.*{says}"):
        chain_from_texts([text])


def test_learning_is_run_or_apply() -> None:
    assert [learning_from_text(text) for text in ("run", "apply")] == ["run", "apply"]
    with pytest.raises(ReplayError, match=r"--mag-learning 'on' is not known\. Give run .* or apply"):
        learning_from_text("on")


def test_later_settings_win_and_an_unknown_one_is_refused() -> None:
    assert merged({"nav_rate_hz": 10.0, "use_baro": False}, {"nav_rate_hz": 100.0}).nav_rate_hz == 100.0
    with pytest.raises(ReplayError, match=r"'nav_rate' is not known \(did you mean nav_rate_hz\?\)"):
        merged({"nav_rate": 3})
