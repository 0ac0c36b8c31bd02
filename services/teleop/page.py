"""The page in a browser: a viser server whose threads only leave presses for the node's one loop."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
from collections import deque
from collections.abc import Sequence

import numpy as np
import viser

from services.teleop import presses as p
from services.teleop.origins import only_from, origins_of
from services.teleop.panels import Panels
from services.teleop.scene import Scene, T_world_map_of
from services.teleop.sliders import JointScale
from services.teleop.teleop import Teleop
from shared.climbing.steel import SteelSurface
from shared.errors import MessageError, PortError
from shared.geometry import Float
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Transforms
from shared.runtime.config import Config

_MAX_PRESSES = 1000
_SCENE_PERIOD_S, _TEXT_PERIOD_S, _CLOUD_PERIOD_S = 1 / 15, 0.2, 0.25
_ANSWER_PERIOD_S = 0.3
_CAMERA_FROM_HIP_M = (1.0, -0.85, 0.4)
_HIP_ABOVE_FOOT_M = 0.2


class Page:
    """Owns the server. `take` gives what was done since, `show` draws; neither waits for a browser.

    A slow browser gets the newest of each value when it is ready for it: viser keeps one of each, not a queue.

    Raises:
        PortError: the port is taken.
    """

    def __init__(
        self,
        config: Config,
        scales: Sequence[JointScale],
        postures: Sequence[str],
        trajectories: Sequence[str],
        steel: SteelSurface,
    ) -> None:
        host, port = config.teleop.host, config.teleop.port
        _refuse_taken(host, port)
        self._presses: deque[p.Presses] = deque(maxlen=_MAX_PRESSES)
        with contextlib.redirect_stdout(io.StringIO()), only_from(origins_of(config.teleop)):  # it prints a box
            self._server = viser.ViserServer(host=host, port=port, label="HyReCRo", verbose=False)
        self._is_closed = threading.Event()
        self._silence_s = config.teleop.silence_s
        self._server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self._server.gui.set_panel_label("HyReCRo")
        self._server.gui.main_panel.dock_right()
        self._server.gui.main_panel.set_width(400)
        self.scene = Scene(self._server, config.teleop.max_points)
        self._panels = Panels(
            self._server.gui,
            self._presses.append,
            scales,
            postures,
            trajectories,
            steel,
            config.sim.magnets,
            config.teleop.speed_share,
        )
        self._look_at(np.add(config.sim.initial_foot_xyz_m, (0, 0, _HIP_ABOVE_FOOT_M)))
        self._hip_m: Float | None = None
        self._due_s = dict.fromkeys(("scene", "text", "cloud"), 0.0)
        self._server.on_client_connect(self._welcome)
        self._server.on_client_disconnect(self._miss)

    def take(self) -> list[p.Presses]:
        """What was done on the page since the last call, in order."""
        return [self._presses.popleft() for _ in range(len(self._presses))]

    def show(self, teleop: Teleop, now_s: float) -> None:
        """Brings the page up to date, each part at its own rate; nothing while nobody looks."""
        clients = self._server.get_clients()
        if not clients:
            return
        if self._is_due("scene", now_s, _SCENE_PERIOD_S):
            self.scene.show(teleop, self._panels.visible)
            self._follow(teleop.newest(Transforms), clients)
        if self._is_due("text", now_s, _TEXT_PERIOD_S):
            self._panels.show(teleop, clients)
        if self._is_due("cloud", now_s, _CLOUD_PERIOD_S):
            self.scene.show_clouds(teleop, T_world_map_of(teleop.newest_static))

    def close(self) -> None:
        """Ends the server."""
        self._is_closed.set()
        self._server.stop()

    def _is_due(self, what: str, now_s: float, period_s: float) -> bool:
        if now_s < self._due_s[what]:
            return False
        self._due_s[what] = now_s + period_s
        return True

    def _look_at(self, point_m: Float) -> None:
        camera = self._server.initial_camera
        camera.look_at = point_m
        camera.position = point_m + np.array(_CAMERA_FROM_HIP_M)
        camera.up = np.array([0.0, 0.0, 1.0])

    def _follow(self, transforms: Transforms | None, clients: dict[int, viser.ClientHandle]) -> None:
        if transforms is None:
            return
        try:
            hip_m = FrameTree(transforms).T_root("hip").translation
        except MessageError:
            return
        before_m, self._hip_m = self._hip_m, hip_m
        if before_m is None or not self._panels.is_camera_following or np.array_equal(before_m, hip_m):
            return
        for client in clients.values():
            client.camera.position = client.camera.position + (hip_m - before_m)

    async def _welcome(self, client: viser.ClientHandle) -> None:
        self._presses.append(p.Joined(client.client_id))
        threading.Thread(target=self._listen, args=(client,), daemon=True).start()

    async def _miss(self, client: viser.ClientHandle) -> None:
        self._presses.append(p.Left(client.client_id))

    def _listen(self, client: viser.ClientHandle) -> None:
        """Asks a browser again and again for something that only a page that is alive can answer."""
        while client.client_id in self._server.get_clients():
            try:
                client.local_storage.get_item("hyrecro", timeout=self._silence_s)
            except TimeoutError:
                continue
            except RuntimeError:  # it is gone, or keeps no storage and says so, which is an answer too
                if client.client_id not in self._server.get_clients():
                    return
            self._presses.append(p.Heard(client.client_id))
            if self._is_closed.wait(_ANSWER_PERIOD_S):
                return


def _refuse_taken(host: str, port: int) -> None:
    """viser would go on to the next port, and nobody would know."""
    try:
        with socket.create_server((host, port)):
            return
    except OSError as error:
        reason = error.strerror or str(error)
        raise PortError(f"cannot listen on {host} port {port}: {reason}; set teleop.host or teleop.port") from error
