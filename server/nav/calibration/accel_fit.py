"""The accelerometer's model a = T (raw − offset) [S0 eq. 3.4] from static poses: three ways to find it.

`closed_form` is S0 (3.5-3.8): six positions. `fit_faces` needs the poses near the axes, `fit_norm` nothing but that the
length at rest is g. The last two work in units of the radius about the poses' centre, so counts and SI, and any offset,
are the same problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from server.nav.calibration.pose import Pose
from server.nav.types import Float

REFERENCES: Final = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
"""Specific force of `types.FACES` in body FRD, in g [S0 eq. 3.5]."""

LENGTH_SIGMA: Final = 3e-4  # of g: what non-linearity and temperature leave of a good MEMS sensor (0.3 mg)
PLACEMENT_RAD: Final = float(np.radians(1.0))  # how well a hand puts a board on its faces
PLACEMENT_WEIGHT: Final = 2.0  # observations that this belief is worth; six faces bring six of their own
REJECT: Final = 1e-3  # chance that a good session loses a pose
TRIANGLE: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AccelFit:
    """What a fit found.

    Attributes:
        offset, matrix: shapes (3,), (3, 3): a = matrix · (raw − offset), m/s².
        offset_sigma, matrix_sigma: 1σ of each.
        length: shape (k,), |a| − g of each pose, m/s².
        placement_rad: RMS angle between the poses and their faces, per axis; NaN for `fit_norm`.
        weights: shape (k,), 1 = used, 0 = left out because it does not fit the others.
    """

    offset: Float
    matrix: Float
    offset_sigma: Float
    matrix_sigma: Float
    length: Float
    placement_rad: float
    weights: Float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """The poses in units of their radius about their centre."""

    centre: Float
    radius: float
    u: Float  # (k, 3)
    sigma: Float  # (k,) noise of the length, of g


def sphere(points: Float) -> tuple[Float, float]:
    """Return centre and radius of the sphere nearest to the points in the algebraic sense; needs ≥ 4 not in a plane."""
    middle = points.mean(axis=0)
    away = points - middle
    size = float(np.sqrt(np.mean(away**2))) or 1.0
    away = away / size
    design = np.column_stack([2.0 * away, np.ones(len(away))])
    solution = np.linalg.lstsq(design, (away**2).sum(axis=1), rcond=None)[0]
    centre = solution[:3]
    return middle + size * centre, size * float(np.sqrt(max(solution[3] + centre @ centre, 1e-12)))


def normalised(poses: Sequence[Pose], centre: Float, radius: float) -> Normal:
    """Return the poses about the centre in units of the radius."""
    means = np.array([pose.accel for pose in poses])
    noise = np.sqrt(np.array([np.mean(pose.sigma**2) for pose in poses])) / radius
    noise = np.where(np.isnan(noise), 0.0, noise)  # not known: `variance_factor` makes up for it
    return Normal(centre=centre, radius=radius, u=(means - centre) / radius, sigma=np.hypot(noise, LENGTH_SIGMA))


def variance_factor(poses: Sequence[Pose], r: Float, spare: int) -> float:
    """Return what the variances are multiplied by so that they hold for residuals that do not fit the poses' noise.

    Never below 1. When the poses show no noise of their own it comes from the residuals alone, whose few degrees of
    freedom ν make the parameters follow Student's law, of variance ν / (ν − 2). NaN when there are none: no sigma.

    Args:
        poses: what was fitted.
        r: length residuals over their noise.
        spare: poses beyond what the lengths determine, ν.
    """
    own = not any(np.isnan(pose.sigma).any() for pose in poses)
    if spare < 1 and not own:
        return float("nan")
    return max(1.0, float(r @ r) / max(spare if own else spare - 2.0, 1.0 if own else 0.5))


def closed_form(faces: Float, gravity: float) -> tuple[Float, Float]:
    """Return offset and T of S0 (3.5-3.8).

    Args:
        faces: shape (6, 3), mean of the raw readings in each of `types.FACES`.
        gravity: m/s².
    """
    offset = np.array([(faces[2 * i, i] + faces[2 * i + 1, i]) / 2.0 for i in range(3)])
    away = faces - offset
    matrix = np.linalg.lstsq(away, gravity * REFERENCES, rcond=None)[0].T
    return offset, np.ascontiguousarray(matrix)


def _result(n: Normal, b: Float, matrix: Float, cov: Float, jac: Float, gravity: float, **more: object) -> AccelFit:
    """Bring a fit in normalised units, a/g = matrix · (u − b), back to the unit of the data."""
    var_b, var_m = np.diag(cov)[:3], np.einsum("ij,jk,ik->i", jac, cov[3:, 3:], jac)
    length = gravity * (np.linalg.norm((n.u - b) @ matrix.T, axis=1) - 1.0)
    return AccelFit(
        offset=n.centre + n.radius * b,
        matrix=np.ascontiguousarray(matrix * (gravity / n.radius)),
        offset_sigma=n.radius * np.sqrt(np.maximum(var_b, 0.0)),
        matrix_sigma=(gravity / n.radius) * np.sqrt(np.maximum(var_m, 0.0)).reshape(3, 3),
        length=length,
        **more,  # type: ignore[arg-type]  # `more` names fields of AccelFit; object loses their types
    )


def _symmetric(six: Float) -> Float:
    out = np.empty((3, 3))
    for value, (i, j) in zip(six, TRIANGLE, strict=True):
        out[i, j] = out[j, i] = value
    return out


SYMMETRIC_JAC: Final = np.array([_symmetric(row).ravel() for row in np.eye(6)]).T


def _covariance(jac: Float) -> Float:
    return np.asarray(np.linalg.pinv(jac.T @ jac))


def norm_residuals(x: Float, n: Normal) -> Float:
    """Return (|M (u − b)| − 1) / σ of each pose; x = [b, the six of a symmetric M]."""
    return np.asarray((np.linalg.norm((n.u - x[:3]) @ _symmetric(x[3:]), axis=1) - 1.0) / n.sigma)


def _norm_jacobian(x: Float, n: Normal) -> Float:
    m = _symmetric(x[3:])
    away = n.u - x[:3]
    a = away @ m
    unit = a / np.linalg.norm(a, axis=1, keepdims=True)
    by_m = np.column_stack(
        [unit[:, i] * away[:, j] + (unit[:, j] * away[:, i] if i != j else 0.0) for i, j in TRIANGLE]
    )
    return np.asarray(np.column_stack([-unit @ m, by_m]) / n.sigma[:, None])


def fit_norm(poses: Sequence[Pose], gravity: float) -> AccelFit:
    """Fit offset and a symmetric matrix so that every pose's length is g; 9 parameters.

    Symmetric, because it is the only choice that turns with the sensor and prefers no axis: the body axes are those
    nearest to the sensor's. Poses are weighted by their noise; one that does not fit the others (it was moved) is left
    out, one at a time, as long as there are more poses than parameters.
    """
    n = normalised(poses, *sphere(np.array([pose.accel for pose in poses])))
    used = np.ones(len(poses), dtype=bool)
    x, jac, r = _solve_norm(n, used)
    while (worst := _outlier(jac, r)) >= 0:
        used[np.flatnonzero(used)[worst]] = False
        x, jac, r = _solve_norm(n, used)
    cov = _covariance(jac) * variance_factor(poses, r, len(r) - 9)
    more = {"placement_rad": float("nan"), "weights": used.astype(np.float64)}
    return _result(n, x[:3], _symmetric(x[3:]), cov, SYMMETRIC_JAC, gravity, **more)


def _solve_norm(n: Normal, used: NDArray[np.bool_]) -> tuple[Float, Float, Float]:
    """Return the solution over the poses in use, its Jacobian and residuals."""
    part = Normal(centre=n.centre, radius=n.radius, u=n.u[used], sigma=n.sigma[used])
    start = np.concatenate([np.zeros(3), [1, 1, 1, 0, 0, 0]])
    x = least_squares(norm_residuals, start, _norm_jacobian, args=(part,), x_scale="jac").x
    return x, _norm_jacobian(x, part), norm_residuals(x, part)


def _outlier(jac: Float, r: Float) -> int:
    """Return the pose whose externally studentised residual is beyond Student's law, −1 for none.

    Its own share in the fit is taken out (hat matrix) and its own error out of the scatter, so that a bad pose does not
    hide behind the scatter that it makes itself; 1 in 1000 good sessions loses a pose.
    """
    k, freedom = len(r), len(r) - 10
    if freedom < 1:
        return -1
    hat = np.einsum("ij,jk,ik->i", jac, _covariance(jac), jac)
    left = np.maximum(1.0 - hat, 1e-6)
    without = np.maximum((r @ r - r**2 / left) / freedom, 1.0)
    student = np.where(left > 0.02, np.abs(r) / np.sqrt(without * left), 0.0)
    worst = int(np.argmax(student))
    return worst if student[worst] > stdtrit(freedom, 1.0 - REJECT / (2 * k)) else -1


def _face_residuals(x: Float, n: Normal, reference: Float, placement: float) -> Float:
    """Return length residuals / σ, then the parts across the face's axis / placement error; x = [b, M row by row]."""
    a = (n.u - x[:3]) @ x[3:].reshape(3, 3).T
    length = np.linalg.norm(a, axis=1)
    across = a / length[:, None]
    across = across[reference == 0.0]  # two per pose
    return np.concatenate([(length - 1.0) / n.sigma, across / placement])


def fit_faces(poses: Sequence[Pose], faces: Sequence[int], gravity: float) -> AccelFit:
    """Fit offset and the full matrix to poses near the six faces; 12 parameters.

    The length of each pose must be g to within the sensor's noise, however it was put down; its direction is the face's
    axis to within a hand's placement error, which the residuals across the axes show (and a belief of 1°, worth two of
    them, where they are few). A plain linear fit mixes the two and lets 1° of placement (0.17 m/s² across) into the
    offset and the scale, where it does not belong.

    Args:
        poses: at least one of each face.
        faces: of each pose, its number in `types.FACES`.
        gravity: m/s².
    """
    faces = list(faces)
    means = np.array([pose.accel for pose in poses])
    per_face = np.array([means[[f == i for f in faces]].mean(axis=0) for i in range(6)])
    centre, matrix = closed_form(per_face, 1.0)
    radius = float(np.cbrt(1.0 / abs(np.linalg.det(matrix))))
    n = normalised(poses, centre, radius)
    reference = REFERENCES[faces]
    placement = PLACEMENT_RAD
    x = np.concatenate([np.zeros(3), (matrix * radius).ravel()])
    freedom = 2.0 * len(poses) - 9.0 + 3.0
    for _ in range(8):
        solved = least_squares(_face_residuals, x, args=(n, reference, placement), x_scale="jac")
        x = solved.x
        across = solved.fun[len(poses) :] * placement
        power = PLACEMENT_WEIGHT * PLACEMENT_RAD**2 + float(across @ across)
        placement = float(np.sqrt(power / (PLACEMENT_WEIGHT + max(freedom - 6.0, 1.0))))
    cov = _covariance(solved.jac) * variance_factor(poses, solved.fun[: len(poses)], len(poses) - 6)
    final = x[3:].reshape(3, 3)
    ones = np.ones(len(poses))
    return _result(n, x[:3], final, cov, np.eye(9), gravity, placement_rad=placement, weights=ones)
