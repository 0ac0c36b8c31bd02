"""The data-flow picture: a column a service, a line a key, drawn from the wiring itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from shared.messaging.channels import CHANNELS, Channel
from tools.docs.wiring import PEOPLE, Wires

_LABEL_PX, _COLUMN_PX, _ROW_PX, _HEAD_PX, _FOOT_PX, _MARGIN_PX = 190, 96, 25, 74, 52, 20
_INK, _FAINT, _PAPER, _STRIPE = "#26323a", "#c9d2d8", "#ffffff", "#f4f7f8"
_COLOURS = {
    PEOPLE: "#8a5a00",
    "teleop": "#8a5a00",
    "player": "#8a5a00",
    "planner": "#b8431f",
    "sim": "#0b6b8a",
    "lidar": "#2b8a3e",
    "depth": "#2b8a3e",
    "mapper": "#5b3fa8",
    "evaluator": "#a32969",
}


def dataflow_svg(wires: Sequence[Wires]) -> str:
    """The picture as SVG text, a column each."""
    columns = {wire.name: _LABEL_PX + _COLUMN_PX * (k + 0.5) for k, wire in enumerate(wires)}
    width = _LABEL_PX + _COLUMN_PX * len(wires) + _MARGIN_PX
    height = _HEAD_PX + _ROW_PX * len(CHANNELS) + _FOOT_PX
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="system-ui, sans-serif" font-size="12.5">',
        "<title>Who sends and who takes what</title>",
        f'<rect width="{width}" height="{height}" rx="8" fill="{_PAPER}"/>',
        *_stripes(width),
        *_heads(columns, height),
    ]
    for k, channel in enumerate(CHANNELS):
        lines += _row(channel, _HEAD_PX + _ROW_PX * (k + 0.5), wires, columns)
    lines += _legend(height - _FOOT_PX / 2 + 4)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _stripes(width: float) -> Iterator[str]:
    for k in range(0, len(CHANNELS), 2):
        y = _HEAD_PX + _ROW_PX * k
        yield f'<rect x="8" y="{y}" width="{width - 16}" height="{_ROW_PX}" rx="4" fill="{_STRIPE}"/>'


def _heads(columns: dict[str, float], height: float) -> Iterator[str]:
    for name, x in columns.items():
        colour = _COLOURS.get(name, _INK)
        words = name.split(" ")
        box_px = _COLUMN_PX - 10
        yield f'<rect x="{x - box_px / 2}" y="14" width="{box_px}" height="40" rx="6" fill="{colour}"/>'
        for k, word in enumerate(words):
            y = 38.5 + 15 * (k - (len(words) - 1) / 2)
            yield _text(x, y, word, fill="#fff", anchor="middle", weight=600)
        yield f'<path d="M{x} 54V{height - _FOOT_PX}" stroke="{_FAINT}" stroke-dasharray="2 4"/>'


def _row(channel: Channel, y: float, wires: Sequence[Wires], columns: dict[str, float]) -> Iterator[str]:
    """A line from who sends to who takes: a disc where it begins, a ring where it is taken."""
    senders = [wire.name for wire in wires if channel.key in wire.sends]
    takers = [wire.name for wire in wires if channel.key in wire.takes]
    is_everyones = not senders or len(senders) == len(wires) - 1
    colour = _INK if is_everyones else _COLOURS.get(senders[0], _INK)
    weight = 600 if channel.is_command else 400
    yield _text(_LABEL_PX - 14, y + 4.3, channel.key, fill=colour, anchor="end", weight=weight)
    if places := [columns[name] for name in (*senders, *takers)]:
        yield f'<path d="M{min(places)} {y}H{max(places)}" stroke="{colour}" stroke-width="1.6"/>'
    for name in senders:
        yield f'<circle cx="{columns[name]}" cy="{y}" r="4.6" fill="{_COLOURS.get(name, _INK)}"/>'
    for name in takers:
        x = columns[name]
        yield f'<circle cx="{x}" cy="{y}" r="4.6" fill="{_PAPER}" stroke="{colour}" stroke-width="2"/>'
        if name in senders:
            yield f'<circle cx="{x}" cy="{y}" r="2.2" fill="{colour}"/>'


def _legend(y: float) -> Iterator[str]:
    x = float(_MARGIN_PX)
    yield f'<circle cx="{x}" cy="{y - 4}" r="4.6" fill="{_INK}"/>'
    yield _text(x + 12, y, "sends")
    yield f'<circle cx="{x + 66}" cy="{y - 4}" r="4.6" fill="{_PAPER}" stroke="{_INK}" stroke-width="2"/>'
    yield _text(x + 78, y, "takes")
    yield _text(x + 132, y, "Bold keys are commands. Of the two sensors the mapper takes one, as mapper.input says.")


def _text(x: float, y: float, text: str, *, fill: str = _INK, anchor: str = "start", weight: int = 400) -> str:
    return f'<text x="{x}" y="{y}" fill="{fill}" text-anchor="{anchor}" font-weight="{weight}">{escape(text)}</text>'
