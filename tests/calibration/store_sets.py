"""Sets for the store's tests."""

from typing import Any

import numpy as np
import pytest

from server.calibration.records import CalibrationSet
from server.calibration.store import StoreError
from server.nav.calibration.codes import failure
from server.nav.calibration.types import CalKind, Check, Residual, Sensor

BOARD = "board-1"


def mag_set(number: float = 0.0, **fields: Any) -> CalibrationSet:
    """A magnetometer's set whose offset tells them apart."""
    given = {"offset": np.array([number, 0.25, -0.1]), "matrix": np.diag([1.1, 0.9, 1.0])}
    return CalibrationSet(
        **{
            "board_id": BOARD,
            "sensor": Sensor.MAG,
            "kind": CalKind.MAG_ELLIPSOID,
            "parameters": given,
            "sigma": {"offset": np.full(3, 0.001), "matrix": np.full((3, 3), np.nan)},
            "created_by": "operator",
            **fields,
        }
    )


def full_set() -> CalibrationSet:
    """Every field at a value that is hard to keep."""
    tiny = np.nextafter(1.0, 2.0)
    return mag_set(
        0.1 + 0.2,
        id="set-1",
        parameters={"offset": np.array([1 / 3, 5e-324, -0.0]), "matrix": np.full((3, 3), tiny), "bias": np.pi},
        sigma={"offset": np.array([np.nan, np.inf, 1e-300])},
        grade="fair",
        coverage=float("nan"),
        residual_before=Residual(value=1e-17, unit="gauss"),
        residual_after=Residual(value=float("nan"), unit="m/s²"),
        samples=12345678901,
        temperature_degc=-0.1,
        created_utc="2026-11-22T12:00:00.000Z",
        software_version="0.1.0",
        source="job-7",
        samples_file="a/b",
        note='a "quoted", two-line\nnote with ° and \u2028',
        verified=Check(
            ok=False,
            residual=Residual(value=0.3, unit="gauss"),
            limit=0.1,
            samples=3,
            failure=failure("motion", 0.2, 0.1, "rad/s"),
        ),
        details={"radius_gauss": 0.5, "unknown": float("nan")},
    )


def code_of(call):
    """Return the code with which the store refuses."""
    with pytest.raises(StoreError) as caught:
        call()
    return caught.value.code
