"""A C header for one's own flight board: the numbers in force, the formula, where they come from."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from server.calibration.exchange.parameters import float32_text
from server.nav.calibration.applied import Calibration
from server.nav.types import Float

_FORMULA = (
    "calibrated = level * matrix * (raw - offset), raw being what the board sent to navdeck: body axes x forward,",
    "y right, z down; rad/s, m/s^2 (specific force: level and at rest z reads -9.8), gauss. Where level is the",
    "identity, navdeck_correct alone does it. Differential pressure and height: calibrated = raw - bias.",
)
_FUNCTION = """\
static inline void navdeck_correct(const float matrix[3][3], const float offset[3], const float raw[3], float out[3])
{
    const float d[3] = {raw[0] - offset[0], raw[1] - offset[1], raw[2] - offset[2]};
    for (int i = 0; i < 3; i++) {
        out[i] = matrix[i][0] * d[0] + matrix[i][1] * d[1] + matrix[i][2] * d[2];
    }
}
"""


def c_header(whole: Calibration, provenance: Iterable[str]) -> str:
    """Return the header: C99 and C++, nothing to link, `static const` tables that a compiler may drop.

    Args:
        whole: what is in force; sensors without a calibration are the identity.
        provenance: lines for people: board, sets, dates, software.
    """
    vectors = (
        ("navdeck_gyro_offset_rad_s", whole.gyro_offset),
        ("navdeck_accel_offset_m_s2", whole.accel_offset),
        ("navdeck_mag_offset_gauss", whole.mag_offset),
    )
    matrices = (
        ("navdeck_gyro_matrix", whole.gyro_matrix),
        ("navdeck_accel_matrix", whole.accel_matrix),
        ("navdeck_mag_matrix", whole.mag_matrix),
        ("navdeck_level", whole.level),
    )
    numbers = (
        ("navdeck_diff_pressure_bias_pa", whole.diff_pressure_bias_pa),
        ("navdeck_baro_bias_m", whole.baro_bias_m),
    )
    parts = [
        _comment([*provenance, "", *_FORMULA]),
        "#ifndef NAVDECK_CALIBRATION_H\n#define NAVDECK_CALIBRATION_H\n",
        *(f"static const float {name}[3][3] = {_matrix(value)};" for name, value in matrices),
        *(f"static const float {name}[3] = {_row(value)};" for name, value in vectors),
        *(f"static const float {name} = {_literal(value)};" for name, value in numbers),
        "",
        _FUNCTION,
        "#endif",
    ]
    return "\n".join(parts) + "\n"


def _comment(lines: Iterable[str]) -> str:
    safe = [" ".join(line.split()).replace("*/", "* /").replace("/*", "/ *").rstrip("\\") for line in lines]
    body = "".join(f" * {line}".rstrip() + "\n" for line in safe)
    return f"/*\n{body} */"


def _literal(value: float) -> str:
    text = float32_text(value)
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def _row(values: Float) -> str:
    return "{" + ", ".join(_literal(float(value)) for value in np.asarray(values)) + "}"


def _matrix(values: Float) -> str:
    return "{\n    " + ",\n    ".join(_row(row) for row in np.asarray(values)) + ",\n}"
