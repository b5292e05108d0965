"""The tables of a sensor folder: file, columns, meaning. Reader, JSON Schema and documentation all come from here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from server.nav.types import SAMPLE_COLUMNS, Kind

T_NS: Final = "t_ns"

COLUMN_MEANING: Final = {
    T_NS: "board time of the sample, ns since power-up; integer, exact",
    "gyro_x_rad_s": "angular rate about body x (forward), rad/s",
    "gyro_y_rad_s": "angular rate about body y (right), rad/s",
    "gyro_z_rad_s": "angular rate about body z (down), rad/s",
    "accel_x_m_s2": "specific force along body x, m/s²",
    "accel_y_m_s2": "specific force along body y, m/s²",
    "accel_z_m_s2": "specific force along body z, m/s²; level and at rest -9.8",
    "mag_x_gauss": "magnetic field along body x, gauss",
    "mag_y_gauss": "magnetic field along body y, gauss",
    "mag_z_gauss": "magnetic field along body z, gauss",
    "pressure_pa": "static pressure, Pa",
    "altitude_m": "barometric altitude, m up",
    "lat_deg": "geodetic latitude WGS-84, degrees",
    "lon_deg": "longitude WGS-84, degrees",
    "alt_m": "height, m up, in the input's own datum",
    "vel_n_m_s": "velocity north, m/s",
    "vel_e_m_s": "velocity east, m/s",
    "vel_d_m_s": "velocity down, m/s",
    "h_acc_m": "receiver's horizontal accuracy, m",
    "v_acc_m": "receiver's vertical accuracy, m",
    "s_acc_m_s": "receiver's speed accuracy, m/s",
    "fix_type": "0-1 none, 2 two-dimensional, 3 three-dimensional, 4 differential, 5 float, 6 fixed",
    "diff_pressure_pa": "pitot minus static pressure, Pa",
    "tas_m_s": "true airspeed, m/s",
    "q_w": "q_nb (body to NED, Hamilton), scalar part",
    "q_x": "q_nb, x part",
    "q_y": "q_nb, y part",
    "q_z": "q_nb, z part",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """One CSV file of a sensor folder.

    Attributes:
        stem: file name without ".csv".
        columns: the contract's columns after t_ns.
        needed: groups of columns; each group needs at least one of its columns present.
        integer: the cells are integers (int32 Q30).
        meaning: one sentence.
    """

    stem: str
    kind: Kind
    columns: tuple[str, ...]
    needed: tuple[tuple[str, ...], ...]
    meaning: str
    integer: bool = False

    @property
    def file(self) -> str:
        """Its file name in the folder."""
        return f"{self.stem}.csv"

    @property
    def places(self) -> tuple[int, ...]:
        """Where each of `columns` goes in a sample row."""
        return tuple(SAMPLE_COLUMNS[self.kind].index(name) for name in self.columns)


def _each(columns: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    return tuple((name,) for name in columns)


_IMU = SAMPLE_COLUMNS[Kind.IMU][:6]
_MAG = SAMPLE_COLUMNS[Kind.MAG]
_GNSS = SAMPLE_COLUMNS[Kind.GNSS][:10]
_REFERENCE = SAMPLE_COLUMNS[Kind.REFERENCE]
_DMP = SAMPLE_COLUMNS[Kind.DMP]

TABLES: Final = (
    Table(stem="mag", kind=Kind.MAG, columns=_MAG, needed=_each(_MAG), meaning="Magnetometer, body FRD."),
    Table(
        stem="baro",
        kind=Kind.BARO,
        columns=("pressure_pa", "altitude_m"),
        needed=(("pressure_pa", "altitude_m"),),
        meaning="Barometer: pressure, altitude, or both.",
    ),
    Table(
        stem="airspeed",
        kind=Kind.AIRSPEED,
        columns=("diff_pressure_pa", "tas_m_s"),
        needed=(("diff_pressure_pa", "tas_m_s"),),
        meaning="Airspeed: differential pressure, true airspeed, or both.",
    ),
    Table(
        stem="gnss",
        kind=Kind.GNSS,
        columns=_GNSS,
        needed=(("lat_deg", "vel_n_m_s"),),
        meaning="GNSS receiver; a row is valid at t_ns - [gnss] delay_s; empty = unknown.",
    ),
    Table(
        stem="dmp",
        kind=Kind.DMP,
        columns=_DMP,
        needed=_each(_DMP),
        integer=True,
        meaning="The board's own six-axis quaternion, int32 Q30 (1.0 = 1073741824).",
    ),
    Table(
        stem="reference",
        kind=Kind.REFERENCE,
        columns=_REFERENCE,
        needed=(("q_w", "lat_deg", "alt_m", "vel_n_m_s"),),
        meaning="A better source to compare with; never reaches an estimator; empty = unknown.",
    ),
    Table(
        stem="imu", kind=Kind.IMU, columns=_IMU, needed=_each(_IMU), meaning="Gyroscope and accelerometer, body FRD."
    ),
)
"""In the order in which samples of equal t_ns reach the engine: every aid before the IMU sample of its stamp."""
