"""What is written about the project is true: the channel table, the settings, the files and commands that are named.

`python -m tests.contract.test_docs` refreshes the table in ARCHITECTURE.md.
"""

import re
from pathlib import Path

import pytest

from shared.messaging.channels import CHANNELS, Channel
from shared.runtime.config import CONFIGS_DIR

ROOT = Path(__file__).parents[2]
ARCHITECTURE = ROOT / "ARCHITECTURE.md"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
SETTINGS = [CONFIGS_DIR / "default.yaml", *sorted((CONFIGS_DIR / "sensors").glob("**/*.yaml"))]
BEGIN, END = "<!-- channels: generated -->\n", "<!-- /channels -->\n"


def channel_table() -> str:
    lines = ["| key `hyrecro/...` | message | rate | delivery | kept | recorded as |", "|---|---|---|---|---|---|"]
    for channel in CHANNELS:
        lines.append(
            f"| {channel.key} | {channel.message.__name__} | {_rate(channel)} | {channel.delivery.name} "
            f"| {'yes' if channel.is_kept else ''} | `{channel.topic}` {channel.ros_type.replace('/msg', '')} |"
        )
    return "\n".join(lines) + "\n"


def _rate(channel: Channel) -> str:
    if channel.is_command:
        return "command"
    return f"{channel.rate_hz:g} Hz" if channel.rate_hz else "on change"


def refresh() -> None:
    head, rest = ARCHITECTURE.read_text().split(BEGIN)
    ARCHITECTURE.write_text(head + BEGIN + channel_table() + END + rest.split(END)[1])


def test_the_channel_table_is_current():
    assert BEGIN + channel_table() + END in ARCHITECTURE.read_text()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    links = re.findall(r"\]\(([^)#:]+)\)", document.read_text())
    assert [link for link in links if not (document.parent / link).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_named_files_exist(document):
    names = re.findall(r"`((?:cli|configs|docs|services|shared|tests|tools)/[\w./-]+)`", document.read_text())
    assert [name for name in names if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("path", SETTINGS, ids=lambda path: path.stem)
def test_every_setting_has_its_unit_or_is_a_plain_number(path):
    text = re.sub(r"#.*", "", path.read_text())
    numbers = re.findall(r"(\w+): \[?-?\d[\d.]*(?:e-?\d+)?(?=[],}\s]|$)", text)
    assert numbers != []
    units = ("_m", "_s", "_hz", "_deg", "_mib", "_kib", "_rad", "_n", "_mps2", "_radps", "_px", "_per_m")
    is_plain = re.compile(
        r"num_\w+|max_iterations|max_map_points|max_points|max_planes|port|seed|reflectivity|detection_steepness"
        r"|\w*(tolerance|score|novelty|factor|friction|share|margin|deviations|stride)"
    )
    assert [name for name in numbers if not (name.endswith(units) or is_plain.fullmatch(name))] == []


if __name__ == "__main__":
    refresh()
