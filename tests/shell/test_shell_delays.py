"""What the API says of the measurements' delays: told and by whom, estimated with its σ, or unknown."""

from dataclasses import replace

from server.nav.types import DelayState, ToldDelay
from server.views import health_out, nav_out
from tests.shell.test_shell_verdict import WELL, snapshot_of

FOUND = (
    DelayState(name="gnss_position", delay_s=0.112, sigma_s=0.004),
    DelayState(name="gnss_velocity", delay_s=0.236, sigma_s=0.006),
)
TOLD = (ToldDelay(name="imu", delay_s=0.011, source="board"), ToldDelay(name="mag", delay_s=0.0, source="settings"))


def test_each_measurement_has_its_delay_and_where_that_is_from() -> None:
    view = replace(WELL, snapshot=snapshot_of(delays=FOUND, told_delays=TOLD))
    out = health_out(view).delays
    assert [(one.measurement, one.delay_s, one.sigma_s, one.source) for one in out] == [
        ("imu", 0.011, None, "board"),
        ("gnss_position", 0.112, 0.004, "estimated"),
        ("gnss_velocity", 0.236, 0.006, "estimated"),
        ("mag", 0.0, None, "settings"),
        ("baro", None, None, "unknown"),
    ]
    assert nav_out(view, "ins_ekf").delays == out


def test_what_was_told_of_the_receiver_is_told_of_its_position_and_its_velocity() -> None:
    told = (ToldDelay(name="gnss", delay_s=0.098, source="board"),)
    out = {one.measurement: one for one in health_out(replace(WELL, snapshot=snapshot_of(told_delays=told))).delays}
    assert out["gnss_position"].delay_s == out["gnss_velocity"].delay_s == 0.098
    assert out["gnss_position"].source == "board"


def test_before_the_first_sample_there_is_nothing_to_say() -> None:
    assert health_out(replace(WELL, snapshot=None)).delays == ()
    assert health_out(replace(WELL, snapshot=snapshot_of(t_ns=-1))).delays == ()
