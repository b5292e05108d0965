"""The demo flight through the whole path, bytes to lanes, against the numbers that were reviewed last.

`./run golden` rewrites the CSV of every lane beside this file; their diff is part of the change. A file holds one row
every three seconds and the columns that its lane fills. Equal up to what another processor's rounding does, no more:
whoever changes an estimate on purpose sees here where and by how much.
"""

from pathlib import Path

import numpy as np
import pytest

from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.lanes.registry import LANES
from server.nav.types import CSV_LANE_COLUMNS, LANE_COLUMNS, EngineSettings, Float, Int
from server.protocol.mavlink import MavlinkProtocol
from server.sim import SimSettings, SimStream

GOLDEN = Path(__file__).parent
FLIGHT_S = 120.0
EVERY_NS = 3_000_000_000
COLUMNS = LANE_COLUMNS[:CSV_LANE_COLUMNS]
TOLERANCE = {"lat_deg": 2e-9, "lon_deg": 2e-9, "alt_m": 1e-4}
"""Of the rest 1e-5: far below any σ, far above rounding."""
MOST_BYTES = 60_000
"""Of all lanes together: what a person still reads in a diff."""

Rows = dict[str, tuple[Int, Float]]


@pytest.fixture(scope="module")
def flight() -> Rows:
    """Stamps and rows of each lane, of two minutes with a GNSS outage in turns."""
    protocol, engine = MavlinkProtocol(), NavEngine(EngineSettings(lanes=LANES), wmm_field)
    rows: dict[str, list[tuple[Int, Float]]] = {}
    for t_ns, data in SimStream(SimSettings(outages_s=((60.0, 75.0),))).run(FLIGHT_S):
        for block in protocol.feed(data, t_ns).blocks:
            for lane in engine.step(block).lanes:
                rows.setdefault(lane.lane, []).append((lane.t_ns, lane.data))
    return {
        lane: (np.concatenate([t for t, _ in parts]), np.concatenate([data for _, data in parts])[:, :CSV_LANE_COLUMNS])
        for lane, parts in rows.items()
    }


def thinned(t_ns: Int, data: Float) -> tuple[Int, Float]:
    """Return one row every three seconds; where attitude and position come in turns, one of each."""
    kinds = [np.isfinite(data[:, COLUMNS.index(name)]) for name in ("q_w", "alt_m")]
    cells = t_ns // EVERY_NS
    first = [np.flatnonzero(known)[np.unique(cells[known], return_index=True)[1]] for known in kinds if known.any()]
    chosen = np.unique(np.concatenate(first)) if first else np.unique(cells, return_index=True)[1]
    apart = not (kinds[0] & kinds[1]).any()
    return (t_ns[chosen], data[chosen]) if apart or len(first) < 2 else (t_ns[first[0]], data[first[0]])


def lines(t_ns: Int, data: Float) -> str:
    """The table as text: six decimals, latitude and longitude to a tenth of a millimetre, nothing for unknown."""
    filled = [i for i in range(len(COLUMNS)) if np.isfinite(data[:, i]).any()]
    digits = [9 if COLUMNS[i] in {"lat_deg", "lon_deg"} else 6 for i in filled]
    body = (
        ",".join([str(t), *("" if x != x else repr(round(x, n) + 0.0) for x, n in zip(row, digits, strict=True))])  # noqa: PLR0124
        for t, row in zip(t_ns.tolist(), data[:, filled].tolist(), strict=True)
    )
    return "\n".join([",".join(("t_ns", *(COLUMNS[i] for i in filled))), *body, ""])


def kept(file: Path) -> tuple[list[str], Int, Float]:
    """Return the columns, stamps and numbers of a golden file."""
    header, *rows = (line.split(",") for line in file.read_text().splitlines())
    values = np.array([[float(cell or "nan") for cell in row[1:]] for row in rows])
    return header[1:], np.array([int(row[0]) for row in rows], dtype=np.int64), values


@pytest.mark.parametrize("lane", LANES)
def test_demo_flight_gives_the_reviewed_numbers(flight: Rows, lane: str, rewrite_golden: bool) -> None:
    file = GOLDEN / f"demo_flight.{lane}.csv"
    t_ns, data = thinned(*flight[lane])
    if rewrite_golden:
        file.write_text(lines(t_ns, data))
    assert file.is_file(), "no golden result for this lane yet: ./run golden"
    names, stamps, values = kept(file)
    np.testing.assert_array_equal(t_ns, stamps)
    for index, name in enumerate(COLUMNS):
        expected = values[:, names.index(name)] if name in names else np.full(len(stamps), np.nan)
        tolerance = TOLERANCE.get(name, 1e-5)
        np.testing.assert_allclose(data[:, index], expected, rtol=1e-5, atol=tolerance, err_msg=f"{lane}: {name}")


def test_golden_results_stay_small_and_belong_to_a_lane() -> None:
    files = {file.name: file.stat().st_size for file in GOLDEN.glob("*.csv")}
    assert set(files) <= {f"demo_flight.{lane}.csv" for lane in LANES}
    assert sum(files.values()) < MOST_BYTES
