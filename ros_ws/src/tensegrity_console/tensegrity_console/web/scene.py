# SPDX-License-Identifier: Apache-2.0
"""The robot in 3D, drawn with viser for every browser that looks; what a page selected is drawn for that page alone."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sim_core.planning.floor_planner import Stance
from sim_core.structure.arrays import Array
from sim_core.structure.topology import FACES, STRUTS, TENDONS
from tensegrity_console.web.floor_clicks import Ground
from tensegrity_console.web.state import Facts, Selection

Color = tuple[int, int, int]
BLUE, ORANGE, GREEN, SKY, YELLOW = (0, 114, 178), (213, 94, 0), (0, 158, 115), (86, 180, 233), (230, 159, 0)
GREY, PALE, DARK = (150, 150, 150), (205, 205, 205), (60, 63, 70)
"""Okabe–Ito: told apart by everyone."""
BODY_M = 0.16
"""Length of an actuator's body; what sticks out of it is its rod."""
FULL_SCALE_N = 40.0
"""Tension that is drawn wholly orange."""
FORCE_M_PER_N = 0.02
TRAIL_POINTS, TRAIL_STEP_M = 400, 0.005
FOLLOW_M = 0.03
LIFT_M = 0.002
"""Things on the floor are drawn a little above it, each kind at a height of its own."""


class _Chosen:
    """What one page selected, in its own view: a face, the ghost of where rehearsals ended, a place."""

    def __init__(self, client: Any):
        self.client = client
        self._drawn: tuple[Any, ...] | None = None
        scene = client.scene
        none, corners, side = np.zeros((1, 2, 3)), np.zeros((3, 3)), np.array([[0, 1, 2]])
        self._lines = {
            name: scene.add_line_segments(name, none, SKY, thickness=width, visible=False)
            for name, width in (("ghost_struts", 0.006), ("ghost_tendons", 0.0015))
        }
        self._place = scene.add_cylinder("place", 0.03, 0.001, ORANGE, opacity=0.7, visible=False)
        self._face = scene.add_mesh_simple(
            "chosen", corners, side, color=ORANGE, opacity=0.6, side="double", cast_shadow=False, visible=False
        )

    def draw(self, corners: Array | None, ghost: Array | None, place: tuple[float, float] | None) -> None:
        """Args: corners: of a face on the floor (3, 2). ghost: joints (12, 3). None: not selected."""
        drawn = (*(None if one is None else np.round(one, 3).tobytes() for one in (corners, ghost)), place)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        with self.client.atomic():
            self._face.visible = corners is not None
            if corners is not None:
                self._face.vertices = np.column_stack([corners, np.full(3, LIFT_M)]).astype(np.float32)
            for name, pairs in (("ghost_struts", STRUTS), ("ghost_tendons", TENDONS)):
                self._lines[name].visible = ghost is not None
                if ghost is not None:
                    self._lines[name].points = ghost[np.array(pairs)].astype(np.float32)
            self._place.visible = place is not None
            if place is not None:
                self._place.position = (*place, 3.0 * LIFT_M)


class Scene:
    """What is drawn. `update` is called from one thread. `path`: of the socket where viser listens."""

    def __init__(self, ground: Ground):
        """Raises ConsoleError: viser cannot be started."""
        from tensegrity_console.web.embedded_viser import PAGE, ViserInside

        self._ground = ground
        self._server = server = ViserInside()
        self.path: Path = server.path
        self._chosen: dict[str, _Chosen] = {}
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.scene.set_up_direction("+z")
        server.initial_camera.position = (0.24, -0.32, 0.27)
        server.initial_camera.look_at = (0.0, 0.0, 0.06)
        server.scene.add_grid("floor", width=8.0, height=8.0, cell_size=0.1, section_size=1.0, cell_color=PALE, section_color=GREY)
        none = np.zeros((1, 2, 3))
        self._lines: dict[str, Any] = {
            name: server.scene.add_line_segments(name, none, color, thickness=width)
            for name, color, width in (
                ("bodies", DARK, 0.020),
                ("rods", (170, 175, 185), 0.009),
                ("tendons", BLUE, 0.004),
                ("trail", GREEN, 0.003),
                ("way", BLUE, 0.005),
                ("keep-in", YELLOW, 0.005),
            )
        }
        self._forces = server.scene.add_arrows("forces", none, YELLOW, shaft_radius=0.003, head_radius=0.007, head_length=0.015)
        self._joints = server.scene.add_point_cloud("joints", np.zeros((12, 3)), np.full((12, 3), 240), point_size=0.011)
        self._joints.point_shape = "circle"
        self._box = server.scene.add_box("box", GREEN, (0.04, 0.04, 0.04))
        self._goal = server.scene.add_cylinder("goal", 0.08, 0.001, GREEN, opacity=0.4, visible=False)
        self._faces = [self._face(slot) for slot in range(4)]
        self._followed: Array | None = None
        self._drawn: tuple[Any, ...] = ()
        self._trail: list[Array] = []

        @server.scene.on_click()
        def _(event: Any) -> None:
            """Makes pages tell of clicks; they go to our server, none comes here."""

        @server.on_client_connect
        async def _(client: Any) -> None:
            self._chosen[PAGE.get()] = _Chosen(client)

        @server.on_client_disconnect
        async def _(client: Any) -> None:
            self._chosen = {page: chosen for page, chosen in self._chosen.items() if chosen.client is not client}

    def close(self) -> None:
        """Let go of the socket."""
        self._server.stop()

    def update(self, facts: Facts, selections: Mapping[str, Selection]) -> None:
        """Draw what is known now. `selections`: of each page, by its number."""
        if len(facts.joints_m) < 13:
            return
        with self._server.atomic():
            joints, box = facts.joints_m[:12], facts.joints_m[12]
            self._draw_robot(joints, box, facts)
            self._draw_trail(joints.mean(axis=0))
            stance = self._ground.stance(facts)
            self._follow(stance)
            self._draw_faces(stance, facts)
            self._draw_way(facts)
        self._draw_area(facts)
        for page, chosen in list(self._chosen.items()):
            self._draw_chosen(chosen, stance, facts, selections.get(page, Selection()))

    def _draw_robot(self, joints: Array, box: Array, facts: Facts) -> None:
        ends = joints[np.array(STRUTS)]
        along = ends[:, 1] - ends[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        self._put("bodies", np.stack([ends[:, 0], ends[:, 0] + BODY_M * along], axis=1))
        self._put("rods", ends)
        self._put("tendons", joints[np.array(TENDONS)], tension_colors(facts.tendon_n))
        self._joints.points = joints.astype(np.float32)
        self._box.position = tuple(box)
        pressed = np.flatnonzero(facts.ground_n > 0.05)
        feet = joints[pressed] * (1.0, 1.0, 0.0)
        arrows = np.stack([feet, feet + np.outer(facts.ground_n[pressed], (0.0, 0.0, FORCE_M_PER_N))], axis=1)
        self._forces.visible = bool(len(pressed))
        if len(pressed):
            self._forces.points = arrows.astype(np.float32)

    def _draw_trail(self, center: Array) -> None:
        spot = center * (1.0, 1.0, 0.0) + (0.0, 0.0, LIFT_M)
        if not self._trail or np.linalg.norm(spot - self._trail[-1]) > TRAIL_STEP_M:
            self._trail = [*self._trail[1 - TRAIL_POINTS :], spot]
            if len(self._trail) > 1:
                self._put("trail", np.stack([self._trail[:-1], self._trail[1:]], axis=1))

    def _draw_faces(self, stance: Stance | None, facts: Facts) -> None:
        """The face stood on and its neighbours, with names and counts of rehearsals; drawn anew only when something changed."""
        tried = {gait["target"]: f" {gait['successes']} of {gait['members']}" for gait in _gaits(facts)}
        place = (stance.face, round(stance.x_m, 2), round(stance.y_m, 2), round(stance.yaw_rad, 1)) if stance else None
        state = (place, tuple(sorted(tried.items())))
        if state == self._drawn:
            return
        self._drawn = state
        shown: list[tuple[Array, Color, float, str]] = []
        if stance is not None:
            shown.append((facts.joints_m[list(FACES[stance.face]), :2], BLUE, 0.45, stance.face))
            near = self._ground.neighbours(stance)
            shown += [(one.corners_m, GREY, 0.3, one.face + tried.get(one.face, "")) for one in near]
        for slot, (mesh, label) in enumerate(self._faces):
            mesh.visible = label.visible = slot < len(shown)
            if slot < len(shown):
                corners, mesh.color, mesh.opacity, label.text = shown[slot]
                mesh.vertices = np.column_stack([corners, np.full(3, 0.5 * LIFT_M)]).astype(np.float32)
                label.position = (*corners.mean(axis=0), 0.01)

    def _face(self, slot: int) -> tuple[Any, Any]:
        corners, side = np.zeros((3, 3)), np.array([[0, 1, 2]])
        scene = self._server.scene
        mesh = scene.add_mesh_simple(f"face_{slot}", corners, side, color=GREY, opacity=0.3, side="double", cast_shadow=False)
        return mesh, scene.add_label(f"label_{slot}", "", visible=False)

    def _follow(self, stance: Stance | None) -> None:
        """Every camera goes along when the robot has come to rest elsewhere."""
        if stance is None:
            return
        spot = np.array((stance.x_m, stance.y_m, 0.0))
        before, self._followed = self._followed, spot
        if before is None or np.linalg.norm(spot - before) > FOLLOW_M:
            shift = spot if before is None else spot - before
            for client in self._server.get_clients().values():
                camera = client.camera
                with suppress(ValueError):  # a view that cannot be moved is that page's trouble alone
                    place, look = np.array(camera.position), np.array(camera.look_at)
                    camera.position, camera.look_at = place + shift, look + shift
            start, at = np.array(self._server.initial_camera.position), np.array(self._server.initial_camera.look_at)
            self._server.initial_camera.position, self._server.initial_camera.look_at = tuple(start + shift), tuple(at + shift)
        else:
            self._followed = before

    def _draw_chosen(self, chosen: _Chosen, stance: Stance | None, facts: Facts, selection: Selection) -> None:
        """The selected face, where most rehearsals of the roll ended, and the selected place."""
        corners = ghost = None
        if stance is not None and facts.roll is None:
            corners = next((one.corners_m for one in self._ground.neighbours(stance) if one.face == selection.target), None)
            end = next((g["ends"][0][0] for g in _gaits(facts) if g["target"] == selection.target and g["ends"]), "")
            ghost = self._ground.ghost_m(stance, end) if end in FACES else None
        chosen.draw(corners, ghost, selection.place_m)

    def _draw_way(self, facts: Facts) -> None:
        way = np.column_stack([facts.way_m, np.full(len(facts.way_m), 2.0 * LIFT_M)])
        self._lines["way"].visible = len(way) > 1
        if len(way) > 1:
            self._put("way", np.stack([way[:-1], way[1:]], axis=1))
        self._goal.visible = facts.goal_m is not None
        if facts.goal_m is not None:
            self._goal.position = (*facts.goal_m, LIFT_M)

    def _draw_area(self, facts: Facts) -> None:
        corners = np.column_stack([facts.keep_in_m, np.full(len(facts.keep_in_m), LIFT_M)])
        self._lines["keep-in"].visible = len(corners) > 2
        if len(corners) > 2:
            self._put("keep-in", np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))

    def _put(self, name: str, points: Array, colors: Array | None = None) -> None:
        """Lines from their ends, (n, 2, 3)."""
        handle = self._lines[name]
        handle.points = points.astype(np.float32)
        if colors is not None:
            handle.colors = colors


def _gaits(facts: Facts) -> list[dict[str, Any]]:
    known = facts.known_rehearsal
    return known["gaits"] if known is not None else []


def tension_colors(tension_n: Array) -> Array:
    """From blue to orange by tension, slack ones pale, (n, 2, 3) of bytes. `tension_n`: (n,)."""
    share = np.clip(tension_n / FULL_SCALE_N, 0.0, 1.0)[:, None]
    colors = (1.0 - share) * np.array(BLUE) + share * np.array(ORANGE)
    colors[np.asarray(tension_n) <= 0.0] = PALE
    return np.repeat(colors.astype(np.uint8)[:, None, :], 2, axis=1)
