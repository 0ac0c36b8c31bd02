"""What is written about the project is true: what is made from code is current, and what is named is there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cli.announcer import NAME as SUPERVISOR
from shared.messaging.channels import CHANNELS, SENSOR_CHANNELS
from shared.runtime.config import CONFIGS_DIR
from tools.docs.dataflow import dataflow_svg
from tools.docs.generated import generated_files
from tools.docs.messages import messages_page
from tools.docs.settings import settings_page
from tools.docs.wiring import PEOPLE, all_wires

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
SETTINGS = [CONFIGS_DIR / "default.yaml", *sorted((CONFIGS_DIR / "sensors").glob("**/*.yaml"))]


def test_what_is_made_from_code_is_current():
    stale = [path.name for path, text in generated_files().items() if not path.exists() or path.read_text() != text]
    assert stale == [], "python -m tools.docs writes them anew"


def test_every_message_has_its_section_and_its_doc():
    page = messages_page()
    missing = [c.message.__name__ for c in CHANNELS if f"\n## {c.message.__name__}\n\nOn `" not in page]
    assert missing == []
    assert re.findall(r"\]\(#(\w+)\)", page) != []


def test_every_setting_says_what_it_means():
    rows = [line for line in settings_page().splitlines() if line.startswith("| `")]
    assert len(rows) > 100
    assert [row for row in rows if row.endswith("|  |")] == [], "a string below it in the code, or a comment"


def test_the_data_flow_shows_every_process_and_key():
    services = {path.parent.name for path in ROOT.glob("services/*/node.py")} - {"sensors"}
    assert {wires.name for wires in all_wires()} == {PEOPLE, SUPERVISOR} | services | set(SENSOR_CHANNELS)
    picture = dataflow_svg(all_wires())
    assert [channel.key for channel in CHANNELS if f">{channel.key}</text>" not in picture] == []


def test_the_mapper_takes_no_truth():
    (mapper,) = (wires for wires in all_wires() if wires.name == "mapper")
    assert {"lidar/points", "depth/image"} < mapper.takes
    assert "tf" not in mapper.takes


def test_every_picture_says_which_command_made_it():
    told = re.findall(r"`([\w.]+\.(?:png|svg))`", (ROOT / "CONTRIBUTING.md").read_text().split("## Pictures")[1])
    assert sorted(told) == sorted(path.name for path in (DOCS / "pictures").iterdir())


def test_the_quick_starts_in_both_languages_have_the_same_commands():
    pages = [(DOCS / name).read_text(encoding="utf-8") for name in ("quick_start.md", "es/inicio_rapido.md")]
    english, spanish = (re.findall(r"```sh\n(.*?)```", page, re.DOTALL) for page in pages)
    assert english == spanish != []


def test_the_readme_stays_short():
    assert len((ROOT / "README.md").read_text().splitlines()) < 150


def test_the_site_is_built_strictly_and_asks_no_other_host(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=quiet, capture_output=True, text=True, timeout=120, check=False)
    assert built.returncode == 0, built.stderr
    pages = [path.read_text(encoding="utf-8") for path in (tmp_path / "site").glob("**/*.html")]
    assert len(pages) > len(DOCUMENTS) - 2
    fetched = r"<(?:script|img|iframe)[^>]*src=\"?(https?:[^\" >]*)|<link[^>]*href=\"?(https?:[^\" >]*)"
    assert [found for page in pages for found in re.findall(fetched, page)] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    links = re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", document.read_text())
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
