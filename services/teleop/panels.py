"""The page's controls: each puts what was done into a queue, and shows how the robot is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import viser

from services.teleop import presses as p, texts
from services.teleop.footing import contact_of
from services.teleop.scene import HIDDEN, LAYERS
from services.teleop.sliders import COARSE, FINE, JointScale
from services.teleop.teleop import Teleop
from shared.climbing.steel import SteelSurface
from shared.messaging.messages import (
    Clock,
    Foot,
    FootStatus,
    JointState,
    LegState,
    MapStatus,
    RecorderAction,
    RecorderControl,
    RecorderStatus,
    SimAction,
    SimControl,
    TrackingMetrics,
    Transforms,
)
from shared.runtime.config import MagnetConfig

Put = Callable[[p.Presses], None]

_STOP_STYLE = (
    "<style>[id='{stop}']{{height:3.2em!important;font-size:1.15em;font-weight:800;letter-spacing:.06em}}"
    ".mantine-Slider-markLabel{{display:none}}</style>"
)
_ESCAPE_IN_FIELDS = (
    "<img src=\"data:,\" hidden onerror=\"window.stopId='{stop}';window.hasEscape||window.addEventListener('keydown',"
    "e=>e.key==='Escape'&&e.target.tagName==='INPUT'&&document.getElementById(window.stopId)?.click(),true);"
    'window.hasEscape=true">'
)
"""viser's keys do nothing while somebody types into a field. A stop must."""
_TIME = {"Pause": SimAction.PAUSE, "Resume": SimAction.RESUME, "Step": SimAction.STEP, "Reset": SimAction.RESET}
_PACES = {"x 0.1": 0.1, "x 0.5": 0.5, "x 1": 1.0, "x 2": 2.0}
_RECORDING = {"Record": RecorderAction.START, "Stop recording": RecorderAction.STOP}
_STEPS = {f"coarse {COARSE:g}\u00b0 {COARSE:g} mm": COARSE, f"fine {FINE:g}\u00b0 {FINE:g} mm": FINE}


class Panels:
    """All controls, grouped; the same for every browser but for who commands."""

    def __init__(
        self,
        gui: viser.GuiApi,
        put: Put,
        scales: Sequence[JointScale],
        postures: Sequence[str],
        trajectories: Sequence[str],
        steel: SteelSurface,
        magnets: MagnetConfig,
        speed_share: float,
    ) -> None:
        self._gui, self._put, self._scales = gui, put, scales
        self._steel, self._magnets = steel, magnets
        self._control: dict[int, tuple[viser.GuiHtmlHandle, viser.GuiButtonHandle]] = {}
        self._build_top()
        tabs = gui.add_tab_group(order=10)
        with tabs.add_tab("Drive"):
            self._build_feet()
            self._build_joints(speed_share, postures)
        with tabs.add_tab("Run"):
            self._build_run(trajectories)
        with tabs.add_tab("View"):
            self._build_view()
        with tabs.add_tab("Log"):
            self._log = gui.add_html("")

    @property
    def visible(self) -> dict[str, bool]:
        """Whether each layer of the scene shall be seen."""
        return {layer: box.value for layer, box in self._layers.items()}

    @property
    def is_camera_following(self) -> bool:
        """Whether the camera goes with the robot."""
        return self._camera.value

    def show(self, teleop: Teleop, clients: Mapping[int, viser.ClientHandle]) -> None:
        """Brings every number and text up to date."""
        self._show_status(teleop)
        self._show_joints(teleop)
        self._show_feet(teleop)
        self._show_control(teleop, clients)
        _set(self._log, texts.log_html(teleop.lines))
        _set(self._warning, texts.last_warning(teleop.lines))
        _set(self._services, texts.rows([("services", texts.services_text(teleop.heartbeat_ages()))]))
        running = texts.coloured("nothing runs", "dim") if teleop.trajectory is None else f"<b>{teleop.trajectory}</b>"
        _set(self._running, texts.rows([("running", running)]))

    # ---- building

    def _build_top(self) -> None:
        stop = self._gui.add_button("STOP  (Esc)", color="red", order=1, hint="Halts every drive at once.")
        self._gui.add_html((_STOP_STYLE + _ESCAPE_IN_FIELDS).format(stop=stop._impl.uuid), order=0)
        self._on_click(stop, lambda client, _: p.Stopped(client, "STOP was pressed"))
        command = self._gui.add_command("Stop the robot", description="halts every drive at once", hotkey="escape")
        command.on_trigger(self._reaction(lambda client, _: p.Stopped(client, "Escape was pressed")))
        self._status = self._gui.add_html("", order=3)
        self._warning = self._gui.add_html("", order=4)

    def _build_feet(self) -> None:
        with self._gui.add_folder("Feet"):
            self._feet = self._gui.add_html("")
            buttons = self._gui.add_button_group("Fix foot", [foot.value for foot in Foot])
            self._on_click(buttons, lambda client, value: p.FootChosen(client, Foot(value)))

    def _build_joints(self, speed_share: float, postures: Sequence[str]) -> None:
        gui = self._gui
        with gui.add_folder("Joints"):
            self._sliders = [
                gui.add_slider(scale.label(0.0), scale.low, scale.high, COARSE, 0.0) for scale in self._scales
            ]
            for joint, slider in enumerate(self._sliders):
                self._on_update(slider, self._mover(joint))
            speed = gui.add_slider("Speed %", 5, 100, 5, round(100 * speed_share), hint="Of the velocity limits.")
            self._on_update(speed, lambda client, value: p.SpeedSet(client, value / 100))
            step = gui.add_button_group("Step", list(_STEPS))
            step.on_click(self._set_step)
            follow = gui.add_checkbox("Follow drag", True, hint="Off: the robot waits for Go.")
            self._on_update(follow, lambda client, value: p.FollowingSet(client, value))
            go = gui.add_button("Go", icon=viser.Icon.PLAYER_PLAY)
            self._on_click(go, lambda client, _: p.GoPressed(client))
        with gui.add_folder("Postures"):
            chosen = gui.add_button_group("Go to", list(postures))
            self._on_click(chosen, lambda client, value: p.PostureChosen(client, value))

    def _build_run(self, trajectories: Sequence[str]) -> None:
        gui = self._gui
        with gui.add_folder("Trajectory"):
            self._running = gui.add_html("")
            choice = gui.add_dropdown("File", list(trajectories))
            run = gui.add_button("Run", icon=viser.Icon.PLAYER_PLAY)
            self._on_click(run, lambda client, _: p.TrajectoryChosen(client, choice.value))
            end = gui.add_button("End", icon=viser.Icon.PLAYER_STOP)
            self._on_click(end, lambda client, _: p.TrajectoryChosen(client, None))
        with gui.add_folder("Simulated time"):
            actions = gui.add_button_group("Time", list(_TIME))
            self._on_click(actions, lambda client, value: p.TimeAsked(client, SimControl(action=_TIME[value])))
            paces = gui.add_button_group("Pace", list(_PACES))
            self._on_click(paces, lambda client, value: p.TimeAsked(client, SimControl(real_time_factor=_PACES[value])))
        with gui.add_folder("Recording"):
            self._recording = gui.add_html("")
            buttons = gui.add_button_group("Recorder", list(_RECORDING))
            self._on_click(
                buttons, lambda client, value: p.RecordingAsked(client, RecorderControl(action=_RECORDING[value]))
            )

    def _build_view(self) -> None:
        with self._gui.add_folder("Show"):
            self._layers = {layer: self._gui.add_checkbox(layer.capitalize(), layer not in HIDDEN) for layer in LAYERS}
        with self._gui.add_folder("Camera"):
            self._camera = self._gui.add_checkbox("Follow robot", True)
        with self._gui.add_folder("Services"):
            self._services = self._gui.add_html("")

    # ---- what was done

    def _mover(self, joint: int) -> Callable[[int, Any], p.Presses]:
        scale = self._scales[joint]
        return lambda client, value: p.JointMoved(client, joint, scale.si(value))

    async def _set_step(self, event: viser.GuiEvent[Any]) -> None:
        for slider in self._sliders:
            slider.step = _STEPS[event.target.value]

    def _on_click(self, handle: Any, made: Callable[[int, Any], p.Presses]) -> None:
        handle.on_click(self._reaction(made))

    def _on_update(self, handle: Any, made: Callable[[int, Any], p.Presses]) -> None:
        handle.on_update(self._reaction(made))

    def _reaction(self, made: Callable[[int, Any], p.Presses]) -> Callable[[Any], Any]:
        async def react(event: Any) -> None:  # not a plain function: those run in a pool, out of order
            if event.client_id is not None:  # None: the value was set from here
                self._put(made(event.client_id, getattr(event.target, "value", None)))

        return react

    # ---- what is shown

    def _show_status(self, teleop: Teleop) -> None:
        lines = [
            ("time", texts.clock_text(teleop.newest(Clock))),
            ("mapper", texts.mapper_text(teleop.newest(MapStatus))),
            ("error", texts.error_text(teleop.newest(TrackingMetrics))),
        ]
        if silent := [name for name, age_s in teleop.heartbeat_ages().items() if age_s > texts.STALE_S]:
            lines.append(("services", texts.coloured(f"silent: {', '.join(silent)}", "bad")))
        _set(self._status, texts.rows(lines))
        _set(self._recording, texts.rows([("recorder", texts.recorder_text(teleop.newest(RecorderStatus)))]))

    def _show_joints(self, teleop: Teleop) -> None:
        state = teleop.newest(JointState)
        if state is None:
            return
        moved = teleop.moved_joints
        for joint, (slider, scale) in enumerate(zip(self._sliders, self._scales, strict=True)):
            value = float(state.q[joint])
            if slider.label != (label := scale.label(value)):
                slider.label = label
            if joint not in moved and abs(slider.value - (shown := scale.shown(value))) > FINE / 2:
                slider.value = shown  # type: ignore[misc]  # its setter has another type

    def _show_feet(self, teleop: Teleop) -> None:
        leg = teleop.newest(LegState)
        lines = [("fixed", texts.foot_text(leg)), ("load", texts.load_text(leg))]
        if leg is not None:
            free_foot = leg.fixed_foot.other
            contact = contact_of(free_foot, teleop.newest(Transforms), self._steel)
            lines.append(("change", texts.change_text(free_foot, contact, self._magnets)))
        lines.append(("last step", texts.step_text(teleop.newest(FootStatus))))
        _set(self._feet, texts.rows(lines))

    def _show_control(self, teleop: Teleop, clients: Mapping[int, viser.ClientHandle]) -> None:
        for gone in self._control.keys() - clients.keys():
            del self._control[gone]
        for client_id, client in clients.items():
            if client_id not in self._control:
                self._control[client_id] = self._add_control(client_id, client)
            text, button = self._control[client_id]
            is_commander = teleop.commander.client == client_id
            others = teleop.commander.num_clients - 1
            watching = f", {others} more watch" if others else ""
            how = (
                texts.coloured(f"You command{watching}", "good")
                if is_commander
                else texts.coloured("You watch", "warn")
            )
            _set(text, texts.rows([("control", how)]))
            if button.visible == is_commander:
                button.visible = not is_commander

    def _add_control(
        self, client_id: int, client: viser.ClientHandle
    ) -> tuple[viser.GuiHtmlHandle, viser.GuiButtonHandle]:
        text = client.gui.add_html("", order=2)
        button = client.gui.add_button("Take control", order=2.5)
        self._on_click(button, lambda _client, _: p.ControlTaken(client_id))
        return text, button


def _set(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content
