"""The live verdict on a real flight: the demo board's bytes, its truth as reference, the engine's snapshot."""

import math

import pytest

from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.types import Aid, EngineSettings, SampleBlock, Snapshot
from server.protocol.mavlink.protocol import MavlinkProtocol
from server.sim import SimSettings, SimStream

GROUPS = ("attitude", "velocity", "position", "lane")


@pytest.fixture(scope="module")
def blocks() -> list[SampleBlock]:
    protocol, board = MavlinkProtocol(talk=False), SimStream(SimSettings(seed=4))
    return [block for k in range(1, 61) for block in protocol.feed(b"".join(board.advance(k * 10**9)), k).blocks]


def snapshot(blocks: list[SampleBlock], *lanes: str, looks: int = 1, **told: float) -> Snapshot:
    engine = NavEngine(EngineSettings(lanes=lanes, lane_parameters={"ins_ekf": told}), wmm_field)
    for block in blocks:
        engine.step(block)
        for _ in range(looks - 1):
            engine.snapshot()
    return engine.snapshot()


def test_a_flight_with_truth_is_judged_in_every_group(blocks: list[SampleBlock]) -> None:
    found = snapshot(blocks, "ins_ekf", "reference").consistency
    assert tuple(one.group for one in found) == GROUPS
    for one in found:
        assert one.low < 1.0 < one.high
        assert math.isfinite(one.mean)
        assert one.verdict != "too-few"
        assert one.samples > 250
        assert 0.0 < one.effective <= 3.0 * one.samples


def test_without_truth_the_innovations_judge_the_lane(blocks: list[SampleBlock]) -> None:
    found = snapshot(blocks, "ins_ekf").consistency
    assert [one.group for one in found] == ["lane"]
    assert found[0].verdict != "too-few"


def test_without_the_main_lane_nothing_is_judged(blocks: list[SampleBlock]) -> None:
    assert snapshot(blocks, "reference").consistency == ()


def test_a_magnetometer_believed_too_much_or_too_little_shows_in_its_verdict(
    blocks: list[SampleBlock],
) -> None:
    """The magnetometer's noise is taken as told, so the verdict follows what is told."""
    verdicts = []
    for mag_noise_gauss in (1e-4, 0.1):
        aids = {aid.aid: aid for aid in snapshot(blocks, "ins_ekf", mag_noise_gauss=mag_noise_gauss).aids}
        verdicts.append(aids[Aid.MAG_FIELD].verdict)
    assert verdicts == ["over-confident", "conservative"]


def test_looking_often_changes_nothing(blocks: list[SampleBlock]) -> None:
    """A verdict is at most a second of board time old."""
    rarely, often = (snapshot(blocks, "ins_ekf", "reference", looks=looks) for looks in (1, 3))
    for one, other in zip(rarely.consistency, often.consistency, strict=True):
        assert one.group == other.group
        assert one.samples == pytest.approx(other.samples, abs=12)
        assert one.mean == pytest.approx(other.mean, rel=0.05)
