"""Sensor folders written the plain way, with Python's own number formatting: nothing of the code under test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

HEADERS = {
    "imu": "t_ns,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2",
    "mag": "t_ns,mag_x_gauss,mag_y_gauss,mag_z_gauss",
    "baro": "t_ns,pressure_pa,altitude_m",
    "gnss": "t_ns,lat_deg,lon_deg,alt_m,vel_n_m_s,vel_e_m_s,vel_d_m_s,h_acc_m,v_acc_m,s_acc_m_s,fix_type",
    "airspeed": "t_ns,diff_pressure_pa,tas_m_s",
    "reference": "t_ns,q_w,q_x,q_y,q_z,lat_deg,lon_deg,alt_m,vel_n_m_s,vel_e_m_s,vel_d_m_s",
    "dmp": "t_ns,q_w,q_x,q_y,q_z",
}
OUTPUT_HEADER = (
    "t_ns,q_w,q_x,q_y,q_z,vel_n_m_s,vel_e_m_s,vel_d_m_s,lat_deg,lon_deg,alt_m,"
    "sigma_att_x_rad,sigma_att_y_rad,sigma_att_z_rad,sigma_vel_n_m_s,sigma_vel_e_m_s,sigma_vel_d_m_s,"
    "sigma_pos_n_m,sigma_pos_e_m,sigma_pos_d_m,gyro_bias_x_rad_s,gyro_bias_y_rad_s,gyro_bias_z_rad_s,"
    "accel_bias_x_m_s2,accel_bias_y_m_s2,accel_bias_z_m_s2,status"
)
LAT_DEG, LON_DEG, ALT_M = 47.4, 8.5, 500.0
G_M_S2 = 9.8062
FIELD_N_GAUSS = (0.214, 0.011, 0.430)
SECOND_NS = 1_000_000_000
START_NS = 5 * SECOND_NS

Row = Sequence[object]


def write_csv(folder: Path, stem: str, rows: Sequence[Row], header: str = "") -> None:
    """Write one file; None = empty cell."""
    lines = [header or HEADERS[stem], *(",".join("" if cell is None else str(cell) for cell in row) for row in rows)]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def stamps_ns(duration_s: float, rate_hz: float, start_ns: int = START_NS) -> list[int]:
    return [start_ns + round(k * SECOND_NS / rate_hz) for k in range(round(duration_s * rate_hz))]


def static_board(folder: Path, duration_s: float = 40.0, imu_hz: float = 200.0, yaw_rad: float = 0.0) -> Path:
    """A level board at rest that points at `yaw_rad` true: IMU, magnetometer, barometer, GNSS and the truth."""
    rng = np.random.default_rng(7)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    field_b = (c * FIELD_N_GAUSS[0] + s * FIELD_N_GAUSS[1], -s * FIELD_N_GAUSS[0] + c * FIELD_N_GAUSS[1], 0.430)
    imu, mag = stamps_ns(duration_s, imu_hz), stamps_ns(duration_s, 20.0)
    gyro, accel = rng.normal(0, 1e-3, (len(imu), 3)), rng.normal(0, 2e-2, (len(imu), 3)) - [0, 0, G_M_S2]
    write_csv(folder, "imu", [(t, *g, *a) for t, g, a in zip(imu, gyro.tolist(), accel.tolist(), strict=True)])
    noise = rng.normal(0, 1e-3, (len(mag), 3)).tolist()
    write_csv(
        folder, "mag", [(t, *(f + n for f, n in zip(field_b, w, strict=True))) for t, w in zip(mag, noise, strict=True)]
    )
    write_csv(folder, "baro", [(t, None, ALT_M + rng.normal(0, 0.06)) for t in mag])
    write_csv(folder, "gnss", [_fix(t, rng) for t in stamps_ns(duration_s, 5.0)])
    truth = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2), LAT_DEG, LON_DEG, ALT_M, 0.0, 0.0, 0.0)
    write_csv(folder, "reference", [(t, *truth) for t in stamps_ns(duration_s, 50.0)])
    (folder / "meta.toml").write_text('[vehicle]\nclass = "multirotor"\n[site]\ndate = 2026-11-22\n')
    return folder


def _fix(t_ns: int, rng: np.random.Generator) -> Row:
    north_m, east_m, up_m, *vel = rng.normal(0, (0.02, 0.02, 0.05, 0.02, 0.02, 0.02)).tolist()
    lat, lon = LAT_DEG + math.degrees(north_m / 6367000), LON_DEG + math.degrees(east_m / 4320000)
    return (t_ns, lat, lon, ALT_M + up_m, *vel, 0.3, 0.3, 0.05, 3)


def read_csv(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return header and cells as text."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    return header.split(","), [line.split(",") for line in lines]
