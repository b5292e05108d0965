"""Prometheus metrics of one service: read from the counters when asked, so that they cost nothing otherwise."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import accumulate
from typing import Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from server.board_view import BoardView
from server.boards import Boards
from server.link.base import LinkState
from server.nav.types import AidStatus, LaneStatus
from server.verdict import lane_status

LATENCY_BUCKETS_S: Final = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.25, 1.0)


class Latency:
    """A histogram of one board; `observe` costs a microsecond, prometheus_client's own thirty."""

    def __init__(self) -> None:
        self._counts = [0] * (len(LATENCY_BUCKETS_S) + 1)
        self._sum_s = 0.0

    def observe(self, latency_s: float) -> None:
        """Count one answer."""
        self._counts[bisect_left(LATENCY_BUCKETS_S, latency_s)] += 1
        self._sum_s += latency_s

    def add_to(self, metric: HistogramMetricFamily, board_id: str) -> None:
        """Write the cumulative counts under the board's label."""
        limits = [*map(str, LATENCY_BUCKETS_S), "+Inf"]
        buckets = list(zip(limits, map(float, accumulate(self._counts)), strict=True))
        metric.add_metric([board_id], buckets=buckets, sum_value=self._sum_s)


class Metrics:
    """A registry of its own, so that several services in one process do not mix."""

    def __init__(self, boards: Boards, clients: Callable[[], int], lost: Callable[[], int]) -> None:
        self.registry = CollectorRegistry()
        self._latencies: dict[str, Latency] = {}
        self.registry.register(_Counters(boards, clients, lost, self._latencies))

    def latency_of(self, board_id: str) -> Callable[[float], None]:
        """Return where a board tells how long its answers took, s."""
        return self._latencies.setdefault(board_id, Latency()).observe

    def forget(self, board_id: str) -> None:
        """Drop what a removed board had told."""
        self._latencies.pop(board_id, None)


class _Counters(Collector):
    def __init__(
        self,
        boards: Boards,
        clients: Callable[[], int],
        lost: Callable[[], int],
        latencies: Mapping[str, Latency],
    ) -> None:
        self._boards, self._clients, self._lost, self._latencies = boards, clients, lost, latencies

    def collect(self) -> Iterable[Metric]:
        """Yield every metric with its present value."""
        yield GaugeMetricFamily("navdeck_ws_clients", "Clients of the stream", self._clients())
        yield CounterMetricFamily("navdeck_ws_lost_messages", "Messages lost by slow clients", self._lost())
        text = "From the arrival of bytes to their results published"
        latency = HistogramMetricFamily("navdeck_step_latency_seconds", text, labels=["board"])
        for board_id, known in self._latencies.items():
            known.add_to(latency, board_id)
        yield latency
        yield from _of_boards([board.view() for board in self._boards])


def _of_boards(views: list[BoardView]) -> Iterator[Metric]:
    yield _counter("link_bytes_in", "Bytes read from the link", views, lambda view: view.link.bytes_in)
    yield _counter("link_bytes_out", "Bytes written to the link", views, lambda view: view.link.bytes_out)
    yield _counter("link_reconnects", "Times the link came back", views, lambda view: view.link.reconnects)
    yield _counter("frames", "Whole, valid frames", views, lambda view: view.stats.frames)
    yield _counter("junk_bytes", "Bytes in no valid frame", views, lambda view: view.stats.bytes_junk)
    yield _counter("crc_errors", "Frames with a wrong checksum", views, lambda view: view.stats.crc_errors)
    yield _counter("unknown_messages", "Frames of unknown kind", views, lambda view: view.stats.unknown_messages)
    yield _counter("steps", "Navigation steps", views, lambda view: view.snapshot.steps if view.snapshot else 0)
    age = GaugeMetricFamily("navdeck_data_age_seconds", "Since the newest sample arrived", labels=["board"])
    for view in views:
        if view.age_s is not None:
            age.add_metric([view.id], view.age_s)
    yield age
    yield from (_links(views), _senders(views), _samples(views), _aids(views), _lanes(views))


def _counter(name: str, text: str, views: list[BoardView], value: Callable[[BoardView], float]) -> Metric:
    metric = CounterMetricFamily(f"navdeck_{name}", text, labels=["board"])
    for view in views:
        metric.add_metric([view.id], value(view))
    return metric


def _links(views: list[BoardView]) -> Metric:
    metric = GaugeMetricFamily("navdeck_link_state", "1 for the link's present state", labels=["board", "state"])
    for view in views:
        for state in LinkState:
            metric.add_metric([view.id, state.value], float(state is view.link.state))
    return metric


def _senders(views: list[BoardView]) -> Metric:
    labels = ["board", "system", "component"]
    metric = CounterMetricFamily("navdeck_lost_frames", "Gaps in the sequence numbers of a sender", labels=labels)
    for view in views:
        for sender in view.stats.senders:
            metric.add_metric([view.id, str(sender.system), str(sender.component)], sender.lost)
    return metric


def _samples(views: list[BoardView]) -> Metric:
    labels = ["board", "sensor", "state"]
    metric = CounterMetricFamily("navdeck_samples", "Samples: fresh, repeated, or refused", labels=labels)
    for view in views:
        for sensor in view.snapshot.sensors if view.snapshot is not None else ():
            metric.add_metric([view.id, sensor.name, "fresh"], sensor.samples)
            metric.add_metric([view.id, sensor.name, "repeated"], sensor.repeated)
            metric.add_metric([view.id, sensor.name, "refused"], sum(count for _, count in sensor.refused))
    return metric


def _aids(views: list[BoardView]) -> Metric:
    labels = ["board", "aid", "status"]
    metric = CounterMetricFamily("navdeck_aids", "Measurements by what became of them", labels=labels)
    for view in views:
        for aid in view.snapshot.aids if view.snapshot is not None else ():
            for status, count in ((AidStatus.FUSED, aid.fused), *aid.refused):
                metric.add_metric([view.id, aid.aid.name.lower(), status.name.lower()], count)
    return metric


def _lanes(views: list[BoardView]) -> Metric:
    labels = ["board", "lane", "status"]
    metric = GaugeMetricFamily("navdeck_lane_status", "1 for the estimator's present state", labels=labels)
    for view in views:
        for lane in view.snapshot.lanes if view.snapshot is not None else ():
            for status in LaneStatus:
                metric.add_metric([view.id, lane.lane, status.name.lower()], float(status is lane_status(lane)))
    return metric
