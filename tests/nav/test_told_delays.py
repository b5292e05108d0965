"""The snapshot says which delays were told and by whom; what nobody told is estimated or missing."""

import math

import numpy as np
import pytest

from server.nav.engine import NavEngine
from server.nav.types import ROW_WIDTH, EngineSettings, Kind, SampleBlock, Snapshot

from .synthetic import circle, field_model

BOARDS_OWN = (0.011, 0.05, 0.098, math.nan, math.nan)
"""A profile: IMU, magnetometer and GNSS known, the baro and the class of vehicle not."""


def profile(t_ns: int) -> SampleBlock:
    data = np.full((1, ROW_WIDTH), np.nan)
    data[0, : len(BOARDS_OWN)] = BOARDS_OWN
    stamp = np.array([t_ns], dtype=np.int64)
    return SampleBlock(kind=np.array([Kind.PROFILE], dtype=np.uint8), t_ns=stamp, t_rx_ns=stamp, data=data)


def after(settings: EngineSettings, *, told_by_board: bool) -> Snapshot:
    """The snapshot after a short circle, with the board's profile in front or without."""
    block = circle(duration_s=4.0)[0].block()
    engine = NavEngine(settings, field_model)
    if told_by_board:
        engine.step(profile(int(block.t_ns[0])))
    engine.step(block)
    return engine.snapshot()


def test_the_boards_word_is_said_to_be_the_boards() -> None:
    told = after(EngineSettings(), told_by_board=True).told_delays
    assert [(one.name, one.delay_s, one.source) for one in told] == [
        ("imu", 0.011, "board"),
        ("mag", 0.05, "board"),
        ("gnss", 0.098, "board"),
    ]


def test_a_setting_wins_over_the_board_and_is_said_to_be_a_setting() -> None:
    settings = EngineSettings(gnss_delay_s=0.2, baro_delay_s=0.0)
    told = {one.name: one for one in after(settings, told_by_board=True).told_delays}
    assert (told["gnss"].delay_s, told["gnss"].source) == (0.2, "settings")
    assert (told["baro"].delay_s, told["baro"].source) == (0.0, "settings")  # a zero that was said is known
    assert told["mag"].source == "board"


@pytest.mark.parametrize("lanes", [("ins_ekf",), ("vqf",)])
def test_what_nobody_told_is_estimated_by_the_main_lane_or_missing(lanes: tuple[str, ...]) -> None:
    snapshot = after(EngineSettings(lanes=lanes, mag_delay_s=0.03), told_by_board=False)
    assert [one.name for one in snapshot.told_delays] == ["mag"]
    found = ["gnss_position", "gnss_velocity"] if lanes == ("ins_ekf",) else []
    assert [one.name for one in snapshot.delays] == found
    assert all(one.sigma_s > 0.0 for one in snapshot.delays)
