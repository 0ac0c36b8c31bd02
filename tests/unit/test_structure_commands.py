import sys

import pytest
from typer.testing import CliRunner

from cli import main as command_line
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box, Cylinder
from shared.world.files import load_structure, save_structure
from shared.world.structure import Member, Structure

ORIGINAL = str(CONFIGS_DIR / "structures" / "original.yaml")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(*words):
    result = CliRunner().invoke(command_line.app, ["structure", *words])
    return result.exit_code, result.output


@pytest.mark.parametrize("kind", ["orthogonal", "crossed", "tower"])
def test_each_kind_is_made(tmp_path, kind):
    code, said = run("new", kind)
    assert (code, said.splitlines()[-1]) == (0, f"{kind}.yaml")
    structure = load_structure(tmp_path / f"{kind}.yaml")
    assert structure.name == kind
    assert f"members: {len(structure.members)} boxes" in said


def test_options_reach_the_generator(tmp_path):
    words = ["--spacing", "1", "--width", "0.1", "--bays", "1x1x2", "--yaw-deg", "10", "--base-z", "3"]
    run("new", "tower", "a.yaml", *words, "--taper", "1", "--bracing", "k")
    run("new", "tower", "b.yaml", *words, "--taper", "1", "--bracing", "k", "--imperfection-mm", "2", "--seed", "5")
    a, b = (load_structure(tmp_path / name) for name in ("a.yaml", "b.yaml"))
    (post,) = (bar for bar in a.members if bar.name == "post_0_0_1")
    assert post.solid.size_m == pytest.approx((0.1, 0.1, 1.05))
    assert post.T_world_member.translation[2] == pytest.approx(4.575)
    assert post.T_world_member.rpy_rad[2] == pytest.approx(0.17453293)
    assert (
        0
        < max(
            abs(x.T_world_member.translation - y.T_world_member.translation).max()
            for x, y in zip(a.members, b.members, strict=True)
        )
        < 0.02
    )


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["new", "pyramid", "a.yaml"], "pyramid"),
        (["new", "tower", "a.yaml", "--bays", "2x2"], "needs three numbers like 2x2x3, got '2x2'"),
        (["new", "orthogonal", "a.yaml", "--taper", "0.5"], "are for towers, not for orthogonal"),
        (["new", "orthogonal", "a.yaml", "--width", "3"], "at most half the spacing"),
        (["show", ORIGINAL, "--out", "a.jpg"], "pictures are .png files, not 'a.jpg'"),
    ],
)
def test_wrong_usage_ends_with_2(tmp_path, words, reason):
    code, said = run(*words)
    assert code == 2
    assert reason in " ".join(said.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["show", "absent.sdf"], "hyrecro: absent.sdf: No such file"),
        (["show", ORIGINAL, "--out", "absent/a.png"], "hyrecro: absent/a.png: there is no folder absent"),
        (["convert", ORIGINAL, "a.dae"], "hyrecro: a.dae: structures are written as .yaml"),
    ],
)
def test_an_unusable_file_ends_with_2(monkeypatch, capsys, words, reason):
    monkeypatch.setattr(sys, "argv", ["hyrecro", "structure", *words])
    with pytest.raises(SystemExit) as caught:
        command_line.main()
    assert caught.value.code == 2
    assert reason in capsys.readouterr().err


def test_a_picture_is_drawn_beside_and_the_steel_counted(tmp_path):
    code, said = run("show", ORIGINAL)
    assert code == 0
    assert "members: 21 boxes\nx -2.000 to 2.000 m\ny -2.200 to 2.200 m\nz 8.000 to 12.000 m\n" in said
    assert "steel 26,376 kg at 7,850 kg/m3\nground at z = 0 m\noriginal.png\n" in said
    assert (tmp_path / "original.png").read_bytes().startswith(b"\x89PNG")


def test_every_solid_counts_but_open_meshes(tmp_path):
    box = mesh_of(Box((1.0, 1.0, 1.0)))
    members = (Member("t", Cylinder(0.5, 2.0), SE3.identity()), Member("b", Box((1.0, 2.0, 3.0)), SE3.trans(5.0)))
    save_structure(Structure("s", (Member("m", box, SE3.identity()),), None), tmp_path / "closed.stl")
    content = bytearray((tmp_path / "closed.stl").read_bytes()[:-50])
    content[80:84] = (11).to_bytes(4, "little")
    (tmp_path / "open.stl").write_bytes(content)
    save_structure(Structure("s", members, None), tmp_path / "s.yaml")
    assert "steel 59,431 kg" in run("convert", "s.yaml", "s.sdf")[1]  # pi / 2 + 6 m3
    assert "members: 1 mesh\n" in (said := run("convert", "closed.stl", "c.yaml")[1])
    assert "steel 7,850 kg at 7,850 kg/m3\nno ground\n" in said
    assert "steel 0 kg at 7,850 kg/m3, without 1 open mesh\n" in run("show", "open.stl")[1]


def test_an_unknown_structure_converts_to_every_format(tmp_path):
    for suffix in ("sdf", "world", "urdf", "stl", "yml"):
        assert run("convert", ORIGINAL, f"original.{suffix}")[0] == 0
        assert len(load_structure(tmp_path / f"original.{suffix}").members) == (1 if suffix == "stl" else 21)
