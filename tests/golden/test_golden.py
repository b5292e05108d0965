"""The demo flight through the whole path, bytes to lanes, against the numbers that were reviewed last.

`./run golden` rewrites the CSV beside this file; its diff is part of the change. Equal up to what another processor's
rounding does, no more: whoever changes an estimate on purpose sees here where and by how much.
"""

from pathlib import Path

import numpy as np
import pytest

from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.types import CSV_LANE_COLUMNS, LANE_COLUMNS, EngineSettings, Float
from server.protocol.mavlink import MavlinkProtocol
from server.sim import SimSettings, SimStream

GOLDEN = Path(__file__).parent
FLIGHT_S = 120.0
EVERY = 50  # rows: one a second
COLUMNS = LANE_COLUMNS[:CSV_LANE_COLUMNS]
TOLERANCE = {"lat_deg": 1e-9, "lon_deg": 1e-9, "alt_m": 1e-4}
"""Of the rest 1e-5: far below any σ, far above rounding."""


@pytest.fixture(scope="module")
def flight() -> dict[str, tuple[Float, Float]]:
    """Stamps and rows of each lane, of two minutes with a GNSS outage in turns."""
    protocol, engine = MavlinkProtocol(), NavEngine(EngineSettings(), wmm_field)
    rows: dict[str, list[tuple[Float, Float]]] = {}
    for t_ns, data in SimStream(SimSettings(outages_s=((60.0, 75.0),))).run(FLIGHT_S):
        for block in protocol.feed(data, t_ns).blocks:
            for lane in engine.step(block).lanes:
                rows.setdefault(lane.lane, []).append((lane.t_ns, lane.data))
    return {
        lane: (np.concatenate([t for t, _ in parts])[::EVERY], np.concatenate([data for _, data in parts])[::EVERY])
        for lane, parts in rows.items()
    }


def lines(t_ns: Float, data: Float) -> str:
    """The table as text; numbers to nine significant digits, degrees to the centimetre's hundredth part."""
    body = (
        ",".join(
            [
                str(t),
                *(f"{x:.10f}" if name.endswith("_deg") else f"{x:.9g}" for name, x in zip(COLUMNS, row, strict=True)),
            ]
        )
        for t, row in zip(t_ns.tolist(), data[:, :CSV_LANE_COLUMNS].tolist(), strict=True)
    )
    return "\n".join([",".join(("t_ns", *COLUMNS)), *body, ""])


@pytest.mark.parametrize("lane", ["ins_ekf"])
def test_demo_flight_gives_the_reviewed_numbers(
    flight: dict[str, tuple[Float, Float]], lane: str, rewrite_golden: bool
) -> None:
    file = GOLDEN / f"demo_flight.{lane}.csv"
    t_ns, data = flight[lane]
    if rewrite_golden:
        file.write_text(lines(t_ns, data))
    table = np.genfromtxt(file, delimiter=",", skip_header=1, dtype=np.float64)
    np.testing.assert_array_equal(t_ns, table[:, 0].astype(np.int64))
    for index, name in enumerate(COLUMNS):
        tolerance = TOLERANCE.get(name, 1e-5)
        np.testing.assert_allclose(data[:, index], table[:, 1 + index], rtol=1e-5, atol=tolerance, err_msg=name)
