"""Calibration jobs as the server would show them: a magnetometer half covered, one fitted, and six positions."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.calibration.scene import CalibrationScene
from server.nav.calibration.sphere_cells import DIRECTIONS, cell_of
from server.nav.calibration.types import FACES, CalKind, Fit, Progress
from server.nav.types import Float

OFFSET: Final = np.array([0.25, -0.12, 0.1])
SOFT: Final = np.array([[1.1, 0.08, 0.0], [0.08, 0.9, 0.05], [0.0, 0.05, 1.0]])
FIELD_GAUSS: Final = 0.5


def field_points(count: int, share: float = 1.0, seed: int = 1, noise_gauss: float = 0.005) -> tuple[Float, Float]:
    """Return directions and raw values, each shape (n, 3), over this share of all directions."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    u = u[u[:, 2] < 2.0 * share - 1.0]
    raw = OFFSET + FIELD_GAUSS * np.linalg.solve(SOFT, u.T).T
    return u, raw + rng.normal(scale=noise_gauss, size=raw.shape)


def mag_job(
    *,
    fitted: bool = False,
    share: float = 0.6,
    count: int = 1500,
    seed: int = 1,
    job_id: str = "mag",
    noise_gauss: float = 0.005,
) -> CalibrationScene:
    """Return a magnetometer's job with a fit so far, or with the final one."""
    u, raw = field_points(count, share, seed, noise_gauss)
    progress = Progress(
        fraction=share,
        phase="rotate",
        instruction="rotate-all-ways",
        points=raw,
        uncovered_b=np.delete(DIRECTIONS, np.unique(cell_of(u)), axis=0),
        offset=tuple(OFFSET),
        matrix=tuple(map(tuple, SOFT)),
    )
    fit = Fit(kind=CalKind.MAG_ELLIPSOID, parameters={"offset": OFFSET, "matrix": SOFT}) if fitted else None
    return CalibrationScene(
        job_id=job_id,
        kind=CalKind.MAG_ELLIPSOID,
        state="fitted" if fitted else "collecting",
        progress=progress,
        fit=fit,
    )


def six_job(done: tuple[str, ...] = (), face_next: str = "nose-up", job_id: str = "six") -> CalibrationScene:
    """Return a job over six positions with these done."""
    progress = Progress(
        fraction=len(done) / 6,
        phase="next-face",
        instruction="put-face",
        faces=tuple(face in done for face in FACES),
        face_next=face_next,
    )
    return CalibrationScene(
        job_id=job_id, kind=CalKind.ACCEL_SIX_POSITION, state="collecting", progress=progress, fit=None
    )
