"""Ellipsoid from moments: adjusted least squares, which noise does not bias [Markovsky, Kukush, Van Huffel 2004].

Ordinary algebraic least squares minimises |D w|²; noise inflates even powers (the mean of x⁴ grows by 6 x² σ²), so its
radii and, with uneven coverage, its centre are wrong by O(σ²) however many samples come. Here every moment is replaced
by its unbiased estimate for isotropic noise of variance s, and s is the smallest for which the matrix becomes singular:
its null vector is the quadric. Null vectors know no norm, hence the result turns, shifts and scales with the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import eigh, sqrtm

from server.nav.calibration.ellipsoid_moments import EXPONENTS
from server.nav.types import Float

QUADRIC: Final = (
    (2, 0, 0),
    (0, 2, 0),
    (0, 0, 2),
    (1, 1, 0),
    (1, 0, 1),
    (0, 1, 1),
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (0, 0, 0),
)
"""Monomials of a quadric, in the order of its ten coefficients."""
_EYE: Final = np.eye(10)
BASIS: Final = {9: _EYE, 6: _EYE[:, [0, 1, 2, 6, 7, 8, 9]], 4: np.column_stack([_EYE[:, :3].sum(axis=1), _EYE[:, 6:]])}
"""Free combinations of the coefficients: tilted; axis-aligned (the axes alike, unlike in S0 (3.11)); a sphere."""
_INDEX: Final = {e: i for i, e in enumerate(EXPONENTS)}
_PRODUCT: Final = np.array([[_INDEX[tuple(np.add(a, b))] for b in QUADRIC] for a in QUADRIC])
ITERATIONS: Final = 40


def _lowered(amount: int) -> Float:
    """Matrix (35, 35) of one power of s: unbiased monomials from the noisy ones (Hermite polynomials)."""
    table = ({0: 1.0}, {0: 1.0}, {0: 1.0, 1: -1.0}, {0: 1.0, 1: -3.0}, {0: 1.0, 1: -6.0, 2: 3.0})
    out = np.zeros((35, 35))
    for to, (i, j, k) in enumerate(EXPONENTS):
        for a, fa in table[i].items():
            for b, fb in table[j].items():
                for c, fc in table[k].items():
                    if a + b + c == amount:
                        out[to, _INDEX[i - 2 * a, j - 2 * b, k - 2 * c]] += fa * fb * fc
    return out


_BY_S: Final = tuple(_lowered(amount) for amount in range(3))


def adjusted(moments: Float, s: float) -> Float:
    """Return unbiased moments, shape (…, 35), for isotropic noise of variance s per axis."""
    return moments @ (_BY_S[0] + s * _BY_S[1] + s * s * _BY_S[2]).T


def normal_matrix(moments: Float) -> Float:
    """Return DᵀD, shape (…, 10, 10), of moments, shape (…, 35)."""
    return moments[..., _PRODUCT]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """|matrix (u − centre)| = 1; `noise` is the standard deviation per axis that the fit found, in the unit of u."""

    centre: Float
    matrix: Float
    noise: float

    @property
    def radius(self) -> float:
        """Geometric mean of the half axes."""
        return float(np.linalg.det(self.matrix) ** (-1.0 / 3.0))

    @property
    def quadric(self) -> Float:
        """Return β, shape (10,), with βᵀφ(u) = |matrix (u − centre)|² − 1."""
        a = self.matrix @ self.matrix
        g = -2.0 * a @ self.centre
        last = self.centre @ a @ self.centre - 1.0
        return np.array([a[0, 0], a[1, 1], a[2, 2], 2 * a[0, 1], 2 * a[0, 2], 2 * a[1, 2], *g, last])


def noise_and_quadric(moments: Float, parameters: int) -> tuple[float, Float]:
    """Return s and β, shape (10,), with the adjusted normal matrix singular and β its null vector.

    The smallest eigenvalue falls with s and is concave near its root: Newton's steps from 0 end at the smallest root.
    """
    basis = BASIS[parameters]
    per = moments / moments[0]
    parts = [basis.T @ normal_matrix(per @ by.T) @ basis for by in _BY_S]
    s = 0.0
    vector = np.zeros(basis.shape[1])
    for _ in range(ITERATIONS):
        values, vectors = eigh(parts[0] + s * parts[1] + s * s * parts[2])
        vector = vectors[:, 0]
        slope = float(vector @ (parts[1] + 2.0 * s * parts[2]) @ vector)
        step = -values[0] / slope if slope < 0.0 else 0.0
        s = max(s + step, 0.0)
        if abs(step) <= 1e-14 + 1e-10 * s:
            break
    return s, basis @ vector


def ellipsoid_from(moments: Float, parameters: int) -> Ellipsoid | None:
    """Return the ellipsoid of total moments, shape (35,), or None when the best quadric is not one."""
    s, beta = noise_and_quadric(moments, parameters)
    a = np.array(
        [[beta[0], beta[3] / 2, beta[4] / 2], [beta[3] / 2, beta[1], beta[5] / 2], [beta[4] / 2, beta[5] / 2, beta[2]]]
    )
    values = np.linalg.eigvalsh(a)
    if values[0] < 0.0 < values[2] or min(abs(values)) <= 1e-9 * max(abs(values)):
        return None
    centre = np.linalg.solve(a, -0.5 * beta[6:9])
    level = centre @ a @ centre - beta[9]
    if not level * values[0] > 0.0:
        return None
    return Ellipsoid(centre=centre, matrix=symmetric_root(a / level), noise=float(np.sqrt(s)))


def symmetric_root(a: Float) -> Float:
    """Return the symmetric positive matrix whose square is `a`; diagonal stays diagonal exactly."""
    if not np.any(a - np.diag(np.diag(a))):
        return np.diag(np.sqrt(np.diag(a)))
    root = np.real(sqrtm(a))
    symmetric: Float = 0.5 * (root + root.T)
    return symmetric


_PAIRS: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def gradient(ellipsoid: Ellipsoid, parameters: int) -> Float:
    """Return G, shape (3 + 6, 3 or 1, 10): ∂e/∂(centre, matrix) = G φ(u), with e = (|M (u − c)|² − 1) / 2.

    The matrix's parameters are xx, yy, zz, xy, xz, yz (axis-aligned: the first three; sphere: their sum).
    """
    m, c = ellipsoid.matrix, ellipsoid.centre
    a = m @ m
    rows = [_linear(-a[i], float(a[i] @ c)) for i in range(3)]
    for i, j in _PAIRS if parameters == 9 else _PAIRS[:3]:
        turn = np.zeros((3, 3))
        turn[i, j] = turn[j, i] = 1.0
        form = 0.5 * (m @ turn + turn @ m)  # ∂e = dᵀ form d
        rows.append(_square(form, c))
    return np.array(rows) if parameters != 4 else np.array([*rows[:3], sum(rows[3:])])


def _linear(weights: Float, constant: float) -> Float:
    return np.array([0, 0, 0, 0, 0, 0, *weights, constant], dtype=np.float64)


def _square(form: Float, c: Float) -> Float:
    linear = -2.0 * form @ c
    mixed = (2 * form[0, 1], 2 * form[0, 2], 2 * form[1, 2])
    return np.array([form[0, 0], form[1, 1], form[2, 2], *mixed, *linear, c @ form @ c])


def misfit(moments: Float, ellipsoid: Ellipsoid) -> Float:
    """RMS of |M (u − c)| − 1 in each cube, shape (m,): |M (u − c)|² − 1, as moments give it, over |M (ū − c)| + 1."""
    beta = ellipsoid.quadric
    square = np.bincount(_PRODUCT.ravel(), weights=np.outer(beta, beta).ravel(), minlength=35)  # (βᵀφ)² by moments
    mean_square = moments @ square / moments[:, 0]
    length = np.linalg.norm((moments[:, 1:4] / moments[:, :1] - ellipsoid.centre) @ ellipsoid.matrix, axis=1)
    off: Float = np.sqrt(np.maximum(mean_square, 0.0)) / (length + 1.0)
    return off


def rms(values: Float, weights: Float) -> float:
    """Root of the weighted mean square."""
    return float(np.sqrt(np.sum(values**2 * weights) / np.sum(weights)))
