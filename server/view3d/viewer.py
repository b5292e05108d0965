"""One browser that looks at one board: its scene, its camera, its wishes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np

from server.nav.types import Float, VehicleClass
from server.view3d.camera import PLAIN_SPAN_M, Camera, fit_m, next_anchor, place_m
from server.view3d.feed import Pose, Quat, Vec3
from server.view3d.geometry import Anchor
from server.view3d.paths import PathColour, Paths
from server.view3d.scene import Scene
from server.view3d.studio import Studio
from server.view3d.studio_layout import PLAIN_ASPECT, camera_place
from server.view3d.trail import Track
from server.view3d.triads import Triads

if TYPE_CHECKING:
    from collections.abc import Mapping

    import viser

    from server.calibration.scene import CalibrationScene

Theme = Literal["dark", "light"]
SceneName = Literal["flight", "calibration"]


class Wishes(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """What the page asks for when it connects: the query of `/view/`."""

    board: str = ""
    camera: Camera = Camera.CHASE
    color: PathColour = PathColour.SPEED
    theme: Theme = "dark"
    scene: SceneName = "flight"


class ViewCommand(msgspec.Struct, kw_only=True, tag_field="type", tag="NavdeckViewCommand"):
    """What the page asks for later, through the view's own socket; None leaves it as it is.

    Attributes:
        board: id of the board to look at.
        camera: how the camera moves from now on.
        color: what the colour of the main path says.
        theme: colours of ground and sky.
        scene: the flight, or the calibration that runs on the board.
        resume: the page has reconnected: take `camera` as it is, without moving what the person sees.
        fit: show everything flown so far; the camera is free afterwards.
        visible: whether anybody can see the canvas; a hidden one is sent nothing.
    """

    board: str | None = None
    camera: Camera | None = None
    color: PathColour | None = None
    theme: Theme | None = None
    scene: SceneName | None = None
    resume: bool = False
    fit: bool = False
    visible: bool | None = None


class Viewer:
    """Used from the event loop only. Costs nothing before `attach` and while not `active`."""

    def __init__(self, wishes: Wishes) -> None:
        self.wishes = wishes
        self.visible = True
        self._client: viser.ClientHandle | None = None
        self._scene: Scene | None = None
        self._paths: Paths | None = None
        self._triads: Triads | None = None
        self._studio: Studio | None = None
        self._anchor = Anchor()
        self._pose: Pose | None = None
        self._jump = True

    @property
    def active(self) -> bool:
        """Whether this viewer wants updates now."""
        return self.visible and self._client is not None

    @property
    def calibrates(self) -> bool:
        """Whether this viewer looks at the calibration instead of the flight."""
        return self._studio is not None

    def attach(self, client: viser.ClientHandle, kind: VehicleClass) -> None:
        """Build the scene: the browser is there and its camera known."""
        self._client = client
        self._build(client, kind)

    def _build(self, client: viser.ClientHandle, kind: VehicleClass, *, jump: bool = False) -> None:
        if self.wishes.scene == "calibration":
            self._scene = self._paths = self._triads = None
            untouched = math.dist(client.camera.position.tolist(), camera_place(1, PLAIN_ASPECT)[0]) < 0.01
            self._studio = Studio(client, kind, self.wishes.theme, stay=not (untouched or jump))
            return
        self._studio = None
        self._scene = Scene(client, kind, self.wishes.theme)
        self._paths = Paths(client.scene, self.wishes.theme)
        self._paths.colour, self._paths.kind = self.wishes.color, kind
        self._triads = Triads(client.scene, self.wishes.theme, self._scene.span_m)
        start_m, _ = place_m(self.wishes.camera, PLAIN_SPAN_M)
        if self._scene.span_m != PLAIN_SPAN_M and math.dist(client.camera.position.tolist(), start_m) < 0.01:
            self._look_from(*place_m(self.wishes.camera, self._scene.span_m))

    def detach(self) -> None:
        """The browser has left."""
        self._client = self._scene = self._paths = self._triads = self._studio = None

    def frame(self, pose: Pose, dt_s: float, attitudes: Mapping[str, Pose] | None = None) -> None:
        """Show the newest pose; `dt_s` since the one before.

        Args:
            pose: of the lane that the vehicle shows.
            dt_s: since the one before.
            attitudes: of the lanes that know nothing else, valid at the same time; None leaves them as they are.
        """
        if self._client is None or self._scene is None or self._paths is None:
            return
        self._pose = pose
        jump, self._jump = self._jump, False
        camera = Camera.FOLLOW if jump and self.wishes.camera == Camera.FREE else self.wishes.camera
        self._anchor = next_anchor(camera, self._anchor, pose.pos_n_m, pose.q_nb, math.inf if jump else dt_s)
        with self._client.atomic():
            self._scene.place(pose, self._anchor)
            self._paths.reach(pose)
            if self._triads is not None and attitudes is not None:
                self._triads.turn(attitudes)

    def hold(self, q_nb: Quat, mag_b_gauss: Vec3 | None) -> None:
        """Show how the vehicle is held, and the present magnetic field (None: unknown), in the calibration scene."""
        if self._studio is not None:
            self._studio.hold(q_nb, mag_b_gauss)

    def calibrate(self, job: CalibrationScene | None) -> None:
        """Show how far the board's calibration is, in the calibration scene; None: there is none."""
        if self._studio is not None:
            self._studio.show(job)

    def survey(self, track: Track, main: str | None, fix_n_m: Vec3 | None, h_acc_m: float) -> None:
        """Show what changes slowly: paths, fixes, uncertainty, sizes."""
        if self._client is None or self._scene is None or self._paths is None:
            return
        with self._client.atomic():
            self._paths.update(track, main)
            self._paths.accuracy(fix_n_m, h_acc_m)
            if self._pose is not None:
                self._scene.spread(self._pose)
                self._scene.zoom(_vec3(self._client.camera.position), self._pose, self._anchor)

    def draw_as(self, kind: VehicleClass) -> None:
        """Draw this class of vehicle, if another one is shown."""
        if self._studio is not None and self._studio.kind != kind:
            self._studio.set_vehicle(kind)
        if self._scene is None or self._paths is None or self._scene.kind == kind:
            return
        self._scene.set_vehicle(kind)
        self._paths.kind = kind
        self._paths.recolour(self.wishes.color, self.wishes.theme)
        if self._triads is not None:
            self._triads.redraw(self.wishes.theme, self._scene.span_m)
        if self._pose is not None:
            self.frame(self._pose, 0.0)
        if self.wishes.camera != Camera.FREE:
            self._look_from(*place_m(self.wishes.camera, self._scene.span_m))

    def obey(self, command: ViewCommand, track: Track | None) -> None:
        """Do what the page asked, except changing the board, which is the view's business."""
        if command.visible is not None:
            self.visible = command.visible
        self._repaint(command.color or self.wishes.color, command.theme or self.wishes.theme)
        if command.scene is not None and command.scene != self.wishes.scene:
            self._change_scene(command.scene)
        if self._studio is not None:
            self._steer_studio(command, self._studio)
            return
        if command.camera is not None:
            self._set_camera(command.camera, stay=command.resume)
        if command.fit and track is not None:
            self._fit(track)

    def _change_scene(self, scene: SceneName) -> None:
        self.wishes.scene = scene
        shown = self._studio or self._scene
        if self._client is None or shown is None:
            return  # built when the browser is there
        with self._client.atomic():
            self._client.scene.remove_by_name("/ned")
        self._build(self._client, shown.kind, jump=True)
        if self._scene is not None:
            self._jump = True
            self._look_from(*place_m(self.wishes.camera, self._scene.span_m))

    def _steer_studio(self, command: ViewCommand, studio: Studio) -> None:
        self.wishes.camera = command.camera or self.wishes.camera  # for the flight, when that is shown again
        if command.fit:
            studio.look()

    def forget_board(self) -> None:
        """Another board is going to be shown: take this one's paths away and start at its place."""
        self._jump, self._pose = True, None
        if self._studio is not None:
            self._studio.forget()
        if self._paths is not None:
            self._paths.clear()
        if self._triads is not None:
            self._triads.clear()

    def _repaint(self, color: PathColour, theme: Theme) -> None:
        changed = (color, theme) != (self.wishes.color, self.wishes.theme)
        self.wishes.color, self.wishes.theme = color, theme
        if changed and self._studio is not None:
            self._studio.set_theme(theme)
        if changed and self._scene is not None and self._paths is not None:
            self._scene.set_theme(theme)
            self._paths.recolour(color, theme)
            if self._triads is not None:
                self._triads.redraw(theme, self._scene.span_m)

    def _set_camera(self, camera: Camera, *, stay: bool) -> None:
        self.wishes.camera = camera
        if stay or camera == Camera.FREE:
            return  # where it is, without a jump
        if self._pose is not None and self._scene is not None:
            self._anchor = next_anchor(camera, self._anchor, self._pose.pos_n_m, self._pose.q_nb, math.inf)
            self._look_from(*place_m(camera, self._scene.span_m))
            self.frame(self._pose, 0.0)

    def _fit(self, track: Track) -> None:
        flown = [trail.points[:, :3] for trail in track.lanes.values()]
        here = np.array([self._pose.pos_n_m if self._pose is not None else (0.0, 0.0, 0.0)])
        if self._client is not None:
            self.wishes.camera = Camera.FREE
            self._look_from(*fit_m(np.vstack([here, *flown]), self._anchor, self._client.camera.aspect))

    def _look_from(self, position_m: Vec3, target_m: Vec3) -> None:
        if self._client is not None:
            with self._client.atomic():
                self._client.camera.position = position_m
                self._client.camera.look_at = target_m


def _vec3(values: Float) -> Vec3:
    x, y, z = values.tolist()
    return x, y, z
