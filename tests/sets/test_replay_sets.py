"""Every set goes through `navdeck replay` as it was written: no loss, nothing ignored, every reference row there."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from server.replay.run import replay
from tests.sets import broad, inertialnav_quad, inertialnav_x8, rtk_drive, umn
from tests.sets.laws import Table

WRITERS: dict[str, Callable[[Path, Path], Path]] = {
    "broad": lambda data, out: broad.write(data, out, 1),
    "rtk_drive": rtk_drive.write,
    "rtk_drive parted": lambda data, out: rtk_drive.write(data, out, velocity_age_s=0.125),
    "quad106": lambda data, out: inertialnav_quad.write(data, out, 106),
    "x8": inertialnav_x8.write,
    "umn": umn.write,
}


@pytest.mark.parametrize("name", WRITERS)
def test_replay_takes_the_set_without_a_loss(shared_data: Path, tmp_path: Path, name: str) -> None:
    written = WRITERS[name](shared_data, tmp_path / "set")
    replay(written, tmp_path / "out", lanes=["reference"])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    rows = (tmp_path / "out" / "reference.csv").read_text().count("\n") - 1
    assert rows == len(Table(written, "reference").t_ns)
    assert not any(summary["losses"].values())
    assert not [note for note in summary["notes"] if "ignored" in note]
