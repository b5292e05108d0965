"""An IMU whose truth is known: poses, hand movements between them, turns; noise and placement as told."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from server.nav.types import ROW_WIDTH, Float, Int

GRAVITY = 9.80665
UP = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
S0_MATRIX = np.array([[0.9638, -0.0090, 0.0018], [0.0142, 0.9666, -0.0143], [-0.0132, 0.0047, 0.9801]])
S0_OFFSET = np.array([-0.0039, 0.0006, 0.0034])
S0_BIAS = np.array([0.0093, -0.0128, -0.0056])


@dataclass(frozen=True, kw_only=True)
class Made:
    """A stream under construction: specific force and rate in the body's axes at a fixed rate."""

    rate_hz: float
    force: list[Float] = field(default_factory=list)
    rate: list[Float] = field(default_factory=list)

    def hold(self, up: Float, seconds: float) -> None:
        """Hold still with this unit vector of the body up."""
        n = round(seconds * self.rate_hz)
        self.force.append(np.tile(GRAVITY * np.asarray(up), (n, 1)))
        self.rate.append(np.zeros((n, 3)))

    def move(self, before: Float, after: Float, seconds: float, rng: np.random.Generator) -> None:
        """Turn by hand from one direction of up to the next, shaking and lifting."""
        n = round(seconds * self.rate_hz)
        axis = np.cross(before, after)
        if np.linalg.norm(axis) < 1e-6:
            axis = np.cross(before, [0.3, 0.5, 0.8])
        axis = axis / np.linalg.norm(axis)
        angle = np.arccos(np.clip(before @ after, -1.0, 1.0))
        phase = np.linspace(0.0, 1.0, n)
        smooth = phase**2 * (3.0 - 2.0 * phase)
        turned = Rotation.from_rotvec(smooth[:, None] * angle * axis).apply(before)
        shake = np.sin(np.pi * phase)[:, None] * rng.normal(0.0, 1.5, (n, 3))
        self.force.append(GRAVITY * turned + shake)
        self.rate.append(-np.gradient(smooth, 1.0 / self.rate_hz)[:, None] * angle * axis + 0.2 * shake / 1.5)

    def turn(self, axis: int, angle_rad: float, seconds: float, up: Float) -> None:
        """Turn on a table about an axis, speeding up and slowing down over a tenth of the time."""
        n = round(seconds * self.rate_hz)
        ramp = np.clip(np.minimum(np.arange(n) + 0.5, n - np.arange(n) - 0.5) / (0.1 * n), 0.0, 1.0)
        rate = np.zeros((n, 3))
        rate[:, axis] = ramp * angle_rad * self.rate_hz / ramp.sum()
        self.rate.append(rate)
        self.force.append(np.tile(GRAVITY * np.asarray(up), (n, 1)))

    def stream(self) -> tuple[Int, Float, Float]:
        """Return stamps, specific force and rate."""
        force, rate = np.concatenate(self.force), np.concatenate(self.rate)
        return np.round(np.arange(len(force)) / self.rate_hz * 1e9).astype(np.int64), force, rate


def table(gyro: Float | None, accel: Float | None, n: int) -> Float:
    """Return sample rows with what is given, the rest NaN."""
    out = np.full((n, ROW_WIDTH), np.nan)
    if gyro is not None:
        out[:, :3] = gyro
    if accel is not None:
        out[:, 3:6] = accel
    return out


def read(force: Float, matrix: Float, offset: Float, noise: float, rng: np.random.Generator) -> Float:
    """Return what a sensor reads for which force = matrix · (raw − offset)."""
    return force @ np.linalg.inv(matrix).T + offset + rng.normal(0.0, noise, force.shape)


def tilted(up: Float, sigma_rad: float, rng: np.random.Generator) -> Float:
    """Return a direction put down wrong by a normal angle about two axes."""
    return Rotation.from_rotvec(rng.normal(0.0, sigma_rad, 3)).apply(np.asarray(up, dtype=float))


def faces_stream(
    rng: np.random.Generator,
    *,
    rate_hz: float = 100.0,
    placement_rad: float = 0.0,
    order: list[int] | None = None,
    hold_s: float = 2.5,
    move_s: float = 1.5,
) -> tuple[Int, Float, Float]:
    """Return a stream that takes the six faces in this order, moved by hand between them."""
    return poses_stream(rng, UP[order or list(range(6))], rate_hz, placement_rad, hold_s, move_s)


def poses_stream(
    rng: np.random.Generator,
    ups: Float,
    rate_hz: float = 100.0,
    placement_rad: float = 0.0,
    hold_s: float = 2.5,
    move_s: float = 1.5,
) -> tuple[Int, Float, Float]:
    """Return a stream that holds each of these directions up, moved by hand between them."""
    made = Made(rate_hz=rate_hz)
    before = None
    for up in ups:
        now = tilted(up, placement_rad, rng)
        if before is not None:
            made.move(before, now, move_s, rng)
        made.hold(now, hold_s)
        before = now
    return made.stream()


def spread_directions(n: int, rng: np.random.Generator) -> Float:
    """Return n directions evenly over the sphere, turned at random."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    angle = np.pi * (1.0 + np.sqrt(5.0)) * i
    flat = np.sqrt(1.0 - z * z)
    points = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
    return Rotation.random(random_state=rng).apply(points)
