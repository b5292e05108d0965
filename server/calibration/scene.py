"""What the 3D view draws of a calibration; built on demand, a few times a second."""

from __future__ import annotations

from dataclasses import dataclass

from server.nav.calibration.types import CalKind, Fit, Progress


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationScene:
    """One job as it is to be drawn.

    Attributes:
        job_id: changes with the job, so that nothing of an older one stays.
        state: as on the wire: "collecting", "paused", "fitted", …
        progress: points, uncovered directions, faces, the pose to take, the fit so far.
        fit: the result; None before.
    """

    job_id: str
    kind: CalKind
    state: str
    progress: Progress
    fit: Fit | None
