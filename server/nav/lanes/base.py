"""What a lane is: one estimator, fed the same navigation steps and measurements as every other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from server.nav.types import AidRows, EngineSettings, Event, Float, Int, LaneRows, Site

Provides = Literal["full", "attitude", "altitude"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One number of a lane that a person may change while it runs.

    Attributes:
        name: ends in its unit, as every name does.
        unit: as shown to people; "" for a pure number.
        default: NaN = the vehicle class's own.
        minimum, maximum: both allowed.
        meaning: one sentence: what it does and which way to turn it.
    """

    name: str
    unit: str
    default: float
    minimum: float
    maximum: float
    meaning: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneContext:
    """All a lane may know beside samples.

    Attributes:
        settings: the engine's.
        t0_ns: board time the kernels count from.
        delays_s: IMU, magnetometer, GNSS, baro: a sample stamped t is valid at t − delay; NaN = nobody knows.
        vehicle: value of `VehicleClass`.
        values: the lane's own parameters, every one present, validated.
    """

    settings: EngineSettings
    t0_ns: int
    delays_s: tuple[float, float, float, float]
    vehicle: int
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneResult:
    """What one call gave: rows, and for the main lane its aid records and events."""

    rows: LaneRows
    aids: AidRows | None = None
    events: tuple[Event, ...] = ()


class Lane(Protocol):
    """One estimator. All methods are called from one task, in board time; the constructor takes a `LaneContext`.

    Measurements whose `M_STATUS` is not FUSED are not to be used: withheld, disabled or refused ones come along for
    the record. A lane whose own numbers went bad starts again from nothing and publishes status FAILED for that step;
    one that raises is put aside by the engine and shown failed.

    A lane that needs the whole recording (`registry.AFTERWARDS`) gives no rows in `step` and all of them in a further
    method `finish() -> LaneResult`, called once at the end of a power-up (`bank.LaneBank.finish`).
    """

    name: ClassVar[str]
    provides: ClassVar[Provides]
    parameters: ClassVar[tuple[Parameter, ...]]

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over navigation steps and the measurements that arrived with them.

        Args:
            steps: shape (n, U_SIZE), columns `ekf.layout`.
            meas: shape (k, M_SIZE), in order of arrival.
            t_ns: shape (n,), board time of each step's end.
        """
        ...

    def set_site(self, site: Site) -> None:
        """Take the local frame's origin and magnetic field; steps from here on may use them."""
        ...

    def configure(self, context: LaneContext) -> None:
        """Take other parameters, delays or vehicle class from the next step on; the state stays."""
        ...
