"""The recorded flight through filters: what they delay reaches the estimator, or it would cost what is shown here."""

import math

import numpy as np
import pytest

from server.chain_values import chain_values
from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.preprocess.conditioning import Conditioning
from server.nav.preprocess.lowpass import lowpass_delay
from server.nav.types import EngineSettings
from server.replay.run import replay

BUTTERWORTH = ("imu.butterworth_hz=20", "baro.window_samples=3")


def errors(shared_data, folder, texts):
    """Return (attitude degrees, height m, worst velocity m/s), RMS against the truth from 30 s after the first fix."""

    def engine(settings, model):
        told = {name: getattr(settings, name) for name in EngineSettings.__dataclass_fields__}
        return NavEngine(EngineSettings(**(told | {"chain": chain_values(texts)})), model)

    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    lanes = replay(log, folder, lanes=["ins_ekf", "reference"], engine_factory=engine).lanes
    found = next(lane for name, lane in lanes.items() if name == "ins_ekf").settled
    speed = max(found.vel_n_m_s.rms, found.vel_e_m_s.rms, found.vel_d_m_s.rms)
    return np.array([math.degrees(found.attitude_rad.rms), found.vertical_less_median_m.rms, speed])


@pytest.fixture(scope="module")
def unfiltered(shared_data, tmp_path_factory):
    return errors(shared_data, tmp_path_factory.mktemp("plain") / "out", ())


@pytest.mark.parametrize(
    "texts",
    [BUTTERWORTH, ("imu.butterworth_hz=5",), ("accel.butterworth_hz=10",), ("imu.lowpass_hz=10",)],
)
def test_filters_whose_delay_is_known_cost_next_to_nothing(shared_data, tmp_path, unfiltered, texts):
    assert (errors(shared_data, tmp_path / "out", texts) < 1.1 * unfiltered).all()


def test_filters_whose_delay_is_kept_secret_cost_much(shared_data, tmp_path, unfiltered, monkeypatch):
    """So the test above can fail: 11 ms untold are 0.1 degrees at this flight's turns."""
    monkeypatch.setattr(Conditioning, "imu_delay_s", property(lambda self: 0.0))
    attitude_deg, _, _ = errors(shared_data, tmp_path / "out", BUTTERWORTH)
    assert attitude_deg > 1.3 * unfiltered[0]


def test_the_delay_told_is_the_filters_own(shared_data):
    from .ekf_mission import mission

    engine = NavEngine(EngineSettings(chain=chain_values(["imu.lowpass_hz=10"])), wmm_field)
    engine.step(mission(shared_data))
    (told,) = engine.snapshot().filter_delays
    assert told.delay_s == pytest.approx(lowpass_delay(10.0), rel=1e-6)
