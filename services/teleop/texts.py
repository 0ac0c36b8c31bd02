"""What the page says, as short pieces of HTML made of messages. Whatever comes from outside is escaped."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping

from services.teleop.teleop import Line
from shared.climbing.steel import SoleContact
from shared.messaging.messages import (
    Clock,
    Foot,
    FootStatus,
    LegState,
    MapStatus,
    RecorderStatus,
    Severity,
    TrackingMetrics,
)
from shared.runtime.config import MagnetConfig

STALE_S = 3.0
"""A service whose heartbeats, one a second, have not come for so long is stale."""
_COLOURS = {"good": "#51cf66", "bad": "#ff6b6b", "warn": "#fcc419", "dim": "#868e96"}
_SEVERITY_COLOURS = {Severity.INFO: "dim", Severity.WARNING: "warn", Severity.ERROR: "bad"}


def coloured(text: str, colour: str) -> str:
    """Escaped text in one of the page's colours: good, bad, warn, dim."""
    return f'<span style="color:{_COLOURS[colour]}">{html.escape(text)}</span>'


def rows(pairs: Iterable[tuple[str, str]]) -> str:
    """A small table: what, and HTML of how it is."""
    body = "".join(
        f'<tr><td style="color:{_COLOURS["dim"]};padding-right:1em;white-space:nowrap;vertical-align:top">'
        f"{html.escape(what)}</td><td>{how}</td></tr>"
        for what, how in pairs
    )
    return f'<table style="font-size:0.85em;margin:0 0.75em 0.5em;border-spacing:0 0.15em">{body}</table>'


def clock_text(clock: Clock | None) -> str:
    """Simulated time and its pace."""
    if clock is None:
        return coloured("no simulation", "bad")
    pace = clock.real_time_factor
    return f"{clock.stamp_ns / 1e9:.1f} s " + (
        coloured("paused", "warn") if pace == 0 else coloured(f"x {pace:g}", "dim")
    )


def mapper_text(status: MapStatus | None) -> str:
    """Whether the mapper knows where it is, and how far it lags."""
    if status is None:
        return coloured("no map yet", "dim")
    state = coloured("tracking", "good") if status.is_tracking else coloured("lost", "bad")
    return f"{state} {coloured(f'lag {status.lag_ms:.0f} ms', 'dim')}"


def error_text(metrics: TrackingMetrics | None) -> str:
    """The trajectory's error against the truth so far."""
    if metrics is None:
        return coloured("not known yet", "dim")
    return f"{1e3 * metrics.ate_rmse_m:.2f} mm {coloured(f'of {metrics.num_poses} poses', 'dim')}"


def recorder_text(status: RecorderStatus | None) -> str:
    """Whether all is recorded, where, and how much room is left."""
    if status is None:
        return coloured("no recorder", "dim")
    sizes = f"{status.num_bytes / 1e6:.0f} MB, {status.free_bytes / 1e9:.1f} GB free"
    if status.is_recording:
        return f"{coloured('recording', 'good')} {coloured(sizes, 'dim')}"
    return coloured(status.text or "not recording", "warn" if status.text else "dim")


def services_text(ages_s: Mapping[str, float]) -> str:
    """Each service that was ever heard: alive, or stale and for how long."""
    if not ages_s:
        return coloured("none heard", "bad")
    return " ".join(
        coloured(f"\u25cf\u00a0{name}", "good")
        if age_s <= STALE_S
        else coloured(f"\u25cb\u00a0{name} silent {age_s:.0f} s", "bad")
        for name, age_s in ages_s.items()
    )


def foot_text(leg: LegState | None) -> str:
    """Which foot is fixed, on what, and how much its magnet has left."""
    if leg is None:
        return coloured("not known", "dim")
    contact = {True: coloured("on steel", "good"), False: coloured("not on steel", "warn"), None: ""}[leg.has_contact]
    holding = "+".join(foot.value for foot in leg.holding or ())
    hold = "" if leg.holding is None or holding == leg.fixed_foot.value else f", holding: {holding or 'nothing'}"
    return f"<b>{leg.fixed_foot.value}</b> {contact}{hold}"


def load_text(leg: LegState | None) -> str:
    """Pull on the magnet, and its margin."""
    if leg is None or leg.load_n is None or leg.margin is None:
        return coloured("not known", "dim")
    colour = "good" if leg.margin > 0.3 else "warn" if leg.margin > 0 else "bad"
    return f"{leg.load_n:.0f} N pull, margin {coloured(f'{100 * leg.margin:.0f} %', colour)}"


def change_text(free_foot: Foot, contact: SoleContact | None, magnets: MagnetConfig) -> str:
    """What a change to the free foot would find."""
    if contact is None:
        return coloured("not known", "dim")
    name = f"foot {free_foot.value} "
    if not contact.coverage:
        return coloured(name + "would hold nothing: no steel within 20 mm of its sole", "bad")
    found = (
        f"{100 * contact.coverage:.0f} % of its sole over steel, gap {round(1e3 * contact.gap_m, 1) + 0.0:.1f} mm, "
        f"{math.degrees(contact.angle_rad):.1f}\u00b0"
    )
    if contact.is_flush(magnets.max_gap_m, math.radians(magnets.max_angle_deg)):
        return coloured(f"{name}would hold: {found}", "good")
    needed = f"all of it within {1e3 * magnets.max_gap_m:g} mm and {magnets.max_angle_deg:g}\u00b0 is needed"
    return coloured(f"{name}would not hold: {found}; {needed}", "warn")


def step_text(status: FootStatus | None) -> str:
    """How the last step of a foot goes."""
    if status is None:
        return coloured("none yet", "dim")
    text = f": {html.escape(status.text)}" if status.text else ""
    return f"foot {status.foot.value} {status.phase.value} {100 * status.progress:.0f} %{text}"


def log_html(lines: Iterable[Line]) -> str:
    """The log, newest first."""
    return "".join(_log_line(line) for line in reversed(list(lines))) or rows([("", coloured("nothing yet", "dim"))])


def last_warning(lines: Iterable[Line]) -> str:
    """The newest line that is a warning or worse, empty if there is none."""
    bad = [line for line in lines if line.severity is not Severity.INFO]
    return _log_line(bad[-1]) if bad else ""


def _log_line(line: Line) -> str:
    return (
        '<div style="font-size:0.8em;margin:0 0.9em 0.35em;line-height:1.3;overflow-wrap:anywhere">'
        f"{coloured(f'{line.stamp_ns / 1e9:.1f} s {line.source}', 'dim')} "
        f"{coloured(line.text, _SEVERITY_COLOURS[line.severity])}</div>"
    )
