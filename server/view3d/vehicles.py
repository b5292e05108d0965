"""The vehicles, to scale, in body axes (forward, right, down; m). Orange shows the front."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from server.nav.types import Float, VehicleClass
from server.view3d import palette
from server.view3d.palette import Rgb
from server.view3d.shapes import Mesh, disc, ellipsoid, fuselage, hoop, merge, mirrored, tube, wing


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One mesh of one colour; opacity None is opaque."""

    name: str
    mesh: Mesh
    rgb: Rgb
    opacity: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """A drawn vehicle; `span_m` is its largest extent and scales cameras, axes and cones."""

    parts: tuple[Part, ...]
    span_m: float


@lru_cache(maxsize=8)
def vehicle(kind: VehicleClass) -> Vehicle:
    """Return the model for a class of vehicle; an unknown one is drawn as a quadrotor."""
    if kind == VehicleClass.FIXED_WING:
        return fixed_wing()
    if kind in {VehicleClass.CAR, VehicleClass.HAND_HELD}:
        return bare_board()
    return quadrotor()


def quadrotor() -> Vehicle:
    """Return a 0.45 m quadrotor."""
    reach, top, rotor_m = 0.16, -0.03, 0.118
    motors = {(sx, sy): np.array([sx * reach, sy * reach, top]) for sx in (1, -1) for sy in (1, -1)}
    body = fuselage(
        [
            *[(0.115, 0.004, 0.012, 0.008), (0.105, 0.002, 0.034, 0.022), (0.06, 0, 0.05, 0.034)],
            *[(-0.05, 0, 0.05, 0.036), (-0.1, -0.004, 0.036, 0.026), (-0.115, -0.004, 0.016, 0.012)],
        ],
        3.0,
    )
    arms = {at: tube(np.array([at[0] * 0.03, at[1] * 0.03, -0.004]), tip, 0.014, 0.009) for at, tip in motors.items()}
    pods = {at: tube(tip - [0, 0, -0.014], tip - [0, 0, 0.022], 0.019, 0.016) for at, tip in motors.items()}
    hubs = merge(*(tube(tip - [0, 0, 0.022], tip - [0, 0, 0.034], 0.007, 0.004) for tip in motors.values()))
    discs = {at: disc(tip - [0, 0, 0.028], rotor_m) for at, tip in motors.items()}
    rims = {at: _moved(hoop(rotor_m, 0.004), tip - [0, 0, 0.028]) for at, tip in motors.items()}
    front, rear = [(1, 1), (1, -1)], [(-1, 1), (-1, -1)]
    parts = (
        Part("body", merge(body, *(arms[at] for at in rear), *(pods[at] for at in rear)), palette.BODY_RGB),
        Part("front", merge(*(arms[at] for at in front), *(pods[at] for at in front)), palette.FRONT_RGB),
        Part("trim", merge(hubs, _skids(), _deck()), palette.TRIM_RGB),
        Part("glass", ellipsoid(np.array([0.1, 0, 0.006]), np.array([0.026, 0.026, 0.018])), palette.GLASS_RGB),
        Part("front-rims", merge(*(rims[at] for at in front)), palette.FRONT_RGB),
        Part("rear-rims", merge(*(rims[at] for at in rear)), palette.REAR_DISC_RGB),
        Part("front-discs", merge(*(discs[at] for at in front)), palette.FRONT_RGB, 0.28),
        Part("rear-discs", merge(*(discs[at] for at in rear)), palette.REAR_DISC_RGB, 0.28),
    )
    return Vehicle(parts, 0.69)


def _moved(mesh: Mesh, by_m: Float) -> Mesh:
    return Mesh(mesh.vertices + by_m, mesh.faces)


def _skids() -> Mesh:
    rail = tube(np.array([0.09, 0.075, 0.095]), np.array([-0.09, 0.075, 0.095]), 0.006, 0.006)
    struts = [tube(np.array([x, 0.03, 0.02]), np.array([x, 0.075, 0.095]), 0.006, 0.005) for x in (0.05, -0.05)]
    right = merge(rail, *struts)
    return merge(right, mirrored(right))


def _deck() -> Mesh:
    mast = tube(np.array([-0.055, 0.0, -0.03]), np.array([-0.055, 0.0, -0.075]), 0.005, 0.005)
    return merge(mast, disc(np.array([-0.055, 0.0, -0.078]), 0.024, 0.01))


def fixed_wing() -> Vehicle:
    """Return an aeroplane of 1.8 m span, port wing tip red, starboard green."""
    body = fuselage(
        [
            *[(0.52, 0, 0.02, 0.02), (0.49, 0, 0.045, 0.045), (0.36, 0, 0.066, 0.07), (0.1, -0.01, 0.07, 0.08)],
            *[(-0.2, -0.014, 0.045, 0.05), (-0.62, -0.03, 0.016, 0.02), (-0.68, -0.034, 0.006, 0.01)],
        ],
        2.3,
    )
    right = wing([(0.16, 0.0, -0.06, 0.27, 0.036), (0.14, 0.55, -0.085, 0.24, 0.03), (0.09, 0.8, -0.1, 0.17, 0.018)])
    tip = wing([(0.09, 0.8, -0.1, 0.17, 0.018), (0.06, 0.87, -0.106, 0.11, 0.012), (0.03, 0.9, -0.11, 0.05, 0.006)])
    tail = wing([(-0.46, 0.0, -0.035, 0.18, 0.018), (-0.5, 0.3, -0.035, 0.12, 0.012)])
    fin = wing([(-0.42, 0, -0.03, 0.24, 0.02), (-0.54, 0, -0.26, 0.13, 0.012)], upright=True)
    spinner = ellipsoid(np.array([0.52, 0.0, 0.0]), np.array([0.06, 0.026, 0.026]))
    propeller = _facing_forward(disc(np.array([0.0, 0.0, 0.0]), 0.17), 0.545)
    parts = (
        Part("body", merge(body, tail, mirrored(tail)), palette.BODY_RGB),
        Part("wings", merge(right, mirrored(right)), palette.TRIM_RGB),
        Part("front", merge(spinner, fin), palette.FRONT_RGB),
        Part("glass", ellipsoid(np.array([0.22, 0, -0.06]), np.array([0.13, 0.05, 0.05])), palette.GLASS_RGB),
        Part("starboard", tip, palette.STARBOARD_RGB),
        Part("port", mirrored(tip), palette.PORT_RGB),
        Part("propeller", propeller, palette.REAR_DISC_RGB, 0.25),
    )
    return Vehicle(parts, 1.8)


def _facing_forward(mesh: Mesh, at_x_m: float) -> Mesh:
    x, y, z = mesh.vertices.T
    return Mesh(np.stack([z + at_x_m, y, -x], axis=1), mesh.faces)


def bare_board() -> Vehicle:
    """Return a flight board of 0.1 m with an arrow, for what is carried or driven."""
    slab = fuselage([(0.05, 0, 0.036, 0.009), (0.047, 0, 0.04, 0.012), (-0.047, 0, 0.04, 0.012)], 6.0)
    end = fuselage([(-0.047, 0, 0.04, 0.012), (-0.05, 0, 0.036, 0.009)], 6.0)
    turn = math.radians(30)
    wings = [
        tube(np.array([0.035, 0, -0.013]), np.array([0.035 - 0.03 * math.cos(turn), s * 0.017, -0.013]), 0.003, 0.003)
        for s in (1, -1)
    ]
    shaft = tube(np.array([0.035, 0, -0.013]), np.array([-0.03, 0, -0.013]), 0.003, 0.003)
    return Vehicle(
        (
            Part("body", merge(slab, end), palette.BODY_RGB),
            Part("front", merge(shaft, *wings), palette.FRONT_RGB),
        ),
        0.1,
    )
