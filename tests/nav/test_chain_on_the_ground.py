"""A calibration that is put in force on the ground: the estimators forget what the worse sensors made them believe."""

from __future__ import annotations

import numpy as np

from server.magnetic import wmm_field
from server.nav.calibration.applied import Calibration
from server.nav.engine import NavEngine
from server.nav.rotation import euler_from_quat
from server.nav.types import EngineSettings, Kind, SampleBlock
from tests.nav.ekf_mission import mission, only

OFFSET_M_S2 = np.array([0.5, 0.0, 0.0])


def pitch_deg(engine: NavEngine) -> float:
    row = engine.snapshot().lanes[0].row
    return float(np.degrees(euler_from_quat(np.ascontiguousarray(row[:4]))[1]))


def leaning(block: SampleBlock) -> SampleBlock:
    data = block.data.copy()
    data[block.kind == Kind.IMU, 3:6] += OFFSET_M_S2
    return SampleBlock(kind=block.kind, t_ns=block.t_ns, t_rx_ns=block.t_rx_ns, data=data)


def test_the_tilt_of_an_offset_is_forgotten_at_once(shared_data):
    """The board at rest with 0.5 m/s² put on x leans by 2.9°; calibrated, it must not go on leaning."""
    block = mission(shared_data, "static")
    early = np.arange(len(block.kind)) < len(block.kind) // 2
    engine, plain = (NavEngine(EngineSettings(lanes=("ins_ekf",)), wmm_field) for _ in range(2))
    plain.step(block)
    engine.step(only(leaning(block), early))
    assert abs(pitch_deg(engine) - pitch_deg(plain)) > 2.0
    engine.set_calibration(Calibration(accel_offset=OFFSET_M_S2))
    result = engine.step(only(leaning(block), ~early))
    assert abs(pitch_deg(engine) - pitch_deg(plain)) < 0.3
    assert any("start anew" in event.text for event in result.events if event.code == "calibration-applied")
