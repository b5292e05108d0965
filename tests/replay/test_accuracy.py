"""What users decide from: the main lane's errors on a real autopilot's stream, as it is and made worse."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, FieldModel, Kind, SampleBlock, StepResult
from server.replay.contract import SummaryOut
from server.replay.run import replay


class Spoiled(NavEngine):
    """The same engine behind a worse IMU: a bias and white noise are added to what the board says."""

    def __init__(
        self, settings: EngineSettings, field_model: FieldModel, bias: tuple[float, ...], noise: float
    ) -> None:
        super().__init__(settings, field_model)
        self._bias, self._noise, self._rng = np.array(bias), noise, np.random.default_rng(4)

    def step(self, block: SampleBlock) -> StepResult:
        data, imu = block.data.copy(), block.kind == Kind.IMU
        data[imu, 3:6] += self._bias + self._noise * self._rng.standard_normal((int(imu.sum()), 3))
        kept: dict[str, Any] = {name: getattr(block, name) for name in ("kind", "t_ns", "t_rx_ns", "boot_id")}
        return super().step(SampleBlock(data=data, **kept))


WIRE_STEP_M = 0.0157  # 1e-7 degrees on both axes: at rest the position repeats to the digit and errs by less


def settled(summary: SummaryOut) -> Any:
    """Errors of the main lane from 30 s after the first fix."""
    return next(lane for name, lane in summary.lanes.items() if name == "ins_ekf").settled


def within(errors: Any, attitude_deg: float, horizontal_m: float, vertical_m: float, velocity_m_s: float) -> None:
    assert errors.attitude_rad.rms <= math.radians(attitude_deg)
    assert errors.horizontal_m.rms <= horizontal_m
    assert errors.vertical_less_median_m.rms <= vertical_m
    assert max(errors.vel_n_m_s.rms, errors.vel_e_m_s.rms, errors.vel_d_m_s.rms) <= velocity_m_s
    assert errors.cover_3sigma.horizontal >= 0.95
    sigma_m = errors.sigma_ratio_horizontal * errors.horizontal_m.rms
    assert sigma_m <= max(4.0 * errors.horizontal_m.rms, WIRE_STEP_M)


@pytest.mark.parametrize("log", ["mission", "static"])
def test_the_recorded_stream_is_navigated_as_well_as_promised(shared_data: Path, tmp_path: Path, log: str) -> None:
    summary = replay(shared_data / "ardupilot_sitl" / f"{log}.tlog", tmp_path / "out", lanes=["ins_ekf", "reference"])
    # At rest tilt and accelerometer bias are one unknown: 0.44° here. At this dip the heading takes four times a tilt.
    degrees = 0.30 if log == "mission" else 0.65
    within(settled(summary), attitude_deg=degrees, horizontal_m=0.04, vertical_m=0.04, velocity_m_s=0.018)


@pytest.mark.parametrize(
    ("bias_m_s2", "noise_m_s2"), [((0.1, -0.1, 0.1), 0.0), ((0.2, -0.2, 0.2), 0.0), ((0.0, 0.0, 0.0), 0.2)]
)
def test_a_biased_or_shaken_accelerometer_costs_little(
    shared_data: Path, tmp_path: Path, bias_m_s2: tuple[float, ...], noise_m_s2: float
) -> None:
    summary = replay(
        shared_data / "ardupilot_sitl" / "mission.tlog",
        tmp_path / "out",
        lanes=["ins_ekf", "reference"],
        engine_factory=lambda settings, model: Spoiled(settings, model, bias_m_s2, noise_m_s2),
    )
    within(settled(summary), attitude_deg=0.4, horizontal_m=0.04, vertical_m=0.04, velocity_m_s=0.022)


@pytest.mark.parametrize("begin_s", [70.0, 110.0, 140.0])
def test_a_gnss_outage_of_25_s_is_bridged_with_an_honest_sigma(
    shared_data: Path, tmp_path: Path, begin_s: float
) -> None:
    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    summary = replay(log, tmp_path / "out", lanes=["ins_ekf", "reference"], gnss_outages=[(begin_s, begin_s + 25)])
    lane = next(lane for name, lane in summary.lanes.items() if name == "ins_ekf")
    assert lane.status_rows["dead_reckoning"] > 23 * 50
    (outage,) = lane.outages
    assert outage.rows > 23 * 50
    assert outage.peak_horizontal_sigmas is not None
    assert outage.peak_horizontal_m is not None
    assert outage.peak_horizontal_sigmas <= 3.0
    assert outage.peak_horizontal_m <= 15.0
