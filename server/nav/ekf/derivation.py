"""Derive the straight-line covariance prediction P ← F P Fᵀ + Q and write it as `covariance.py`.

The error dynamics over one navigation step of dt seconds, with f = R_nb·(specific force)·dt in NED and
A = R_nb·dt [Solà 2017, eq. 268-269 with the attitude error taken in the local frame]:

    δθ ← δθ − A δb_g
    δv ← δv − [f]× δθ − A δb_a
    δp ← δp + dt δv
    everything else ← itself

F is mostly zeros and ones, so F P is formed row by row from the few entries that are neither, then (F P) Fᵀ only for
one triangle. Earth and transport rate are in the nominal state; in F they would add 7e-5 rad/s × dt, which is
below the noise densities of any MEMS gyro. The magnetic and wind blocks do not move: their share of F P Fᵀ is the
loop over columns in `predict.predict_columns`, run only where they are active.
Run `python -m server.nav.ekf.derivation > covariance.py`; a test compares it with dense algebra and with this
generator's output.
"""

from __future__ import annotations

import sys
from typing import Final

from server.nav.ekf.states import ACCEL_BIAS, ATT, GYRO_BIAS, INERTIAL, POS, VEL

HEADER: Final = '''"""Straight-line covariance prediction of `ins_ekf`. Written by `derivation.py`; do not edit."""

from __future__ import annotations

from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("void(float64[::1], float64[::1])", contract=True)
def predict_covariance(P: Float, u: Float) -> None:
    """Set P ← F P Fᵀ + Q in place, inertial states [`derivation.py`].

    Args:
        P: packed lower triangle of the error covariance; the first 120 entries are written.
        u: shape (18,): f NED (3) m/s, A = R_nb·dt row by row (9) s, dt s, variances added to each axis of
            attitude rad², velocity m²/s², position m², gyro bias rad²/s², accelerometer bias m²/s⁴.
    """
'''
NOISE_OF_BLOCK: Final = {ATT: 13, VEL: 14, POS: 15, GYRO_BIAS: 16, ACCEL_BIAS: 17}


def transition_rows(n: int) -> list[dict[int, str]]:
    """Return F as one {column: expression} per row, unit diagonal left out; expressions are signed terms."""
    rows: list[dict[int, str]] = [{} for _ in range(n)]
    cross = ((0, 1, "-", 2), (0, 2, "+", 1), (1, 0, "+", 2), (1, 2, "-", 0), (2, 0, "-", 1), (2, 1, "+", 0))
    for axis in range(3):
        for column in range(3):
            rows[ATT + axis][GYRO_BIAS + column] = f"-a{axis}{column}"
            rows[VEL + axis][ACCEL_BIAS + column] = f"-a{axis}{column}"
        rows[POS + axis][VEL + axis] = "+dt"
    for row, column, sign, axis in cross:  # −[f]×, since [f]× has −f2 at (0, 1): the entry is +f2
        rows[VEL + row][ATT + column] = ("-" if sign == "+" else "+") + f"f{axis}"
    return rows


def _sum(first: str, terms: list[tuple[str, str]]) -> str:
    return first + "".join(f" {coef[0]} {coef[1:]} * {name}" for coef, name in terms)


def body(n: int = INERTIAL) -> list[str]:
    """Return the statements: loads, rows of F P, one triangle of (F P) Fᵀ, process noise, stores.

    Args:
        n: number of states; those past the inertial ones do not move (the benchmark's yardstick takes 23).
    """
    index = {(i, j): j * (j + 1) // 2 + i for j in range(n) for i in range(j + 1)}
    rows = transition_rows(n)

    def p(i: int, j: int) -> str:
        return f"p{min(i, j)}_{max(i, j)}"

    def t(i: int, j: int) -> str:
        return f"t{i}_{j}" if rows[i] else p(i, j)

    lines = ["f0, f1, f2 = u[0], u[1], u[2]"]
    lines += [f"a{i}0, a{i}1, a{i}2 = u[{3 + 3 * i}], u[{4 + 3 * i}], u[{5 + 3 * i}]" for i in range(3)]
    lines += ["dt = u[12]"]
    outputs = [(i, j) for i, j in index if rows[i] or rows[j]]
    wanted = {(i, j) for i, j in outputs} | {(i, c) for i, j in outputs for c in rows[j]}
    lines += [f"{p(i, j)} = P[{k}]" for (i, j), k in index.items() if i < INERTIAL]
    for i, j in sorted(wanted):
        if rows[i]:
            lines.append(f"{t(i, j)} = {_sum(p(i, j), [(c, p(k, j)) for k, c in rows[i].items()])}")
    for i, j in outputs:
        lines.append(f"P[{index[i, j]}] = {_sum(t(i, j), [(c, t(i, k)) for k, c in rows[j].items()])}")
    for block, noise in NOISE_OF_BLOCK.items():
        lines += [f"P[{index[block + axis, block + axis]}] += u[{noise}]" for axis in range(3)]
    return lines


def source() -> str:
    """Return the whole text of `covariance.py`."""
    return HEADER + "".join(f"    {line}\n" for line in body())


if __name__ == "__main__":
    sys.stdout.write(source())
