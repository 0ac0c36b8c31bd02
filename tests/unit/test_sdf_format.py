import itertools

import numpy as np
import pytest

from shared.errors import ConfigError, InputFileError
from shared.solids import Box, Cylinder, Mesh
from shared.world.files import load_structure

BAR = "<geometry><box><size>0.2 0.2 4.0</size></box></geometry>"


def original_world() -> str:
    """A world equal to the original simulation's, as Gazebo saves it: the poses that count stand in the state."""
    upright = itertools.product((-1.9, 0.0, 1.9), (-2.1, 0.0, 2.1))
    poses = [(x, y, 10.0, 0.0, 0.0, 0.0) for x, y in upright]
    poses += [(0.0, y, z, 0.0, 1.57, 0.0) for y, z in itertools.product((-2.1, 0.0, 2.1), (10.0, 11.9))]
    poses += [(x, 0.0, z, 1.57, 0.0, 0.0) for x, z in itertools.product((-1.9, 0.0, 1.9), (10.0, 11.9))]
    texts = [" ".join(map(repr, pose)) for pose in poses]
    models = "".join(
        f"<model name='steel bar {i}'><pose frame=''>{i} 3 0.5 0 -0 0</pose><static>1</static><link name='link'>"
        f"<inertial><mass>1</mass></inertial><collision name='collision'>{BAR}</collision>"
        f"<visual name='visual'>{BAR}</visual><pose frame=''>0 0 0 0 -0 0</pose></link></model>"
        for i in range(len(texts))
    )
    states = "".join(
        f"<model name='steel bar {i}'><pose frame=''>{text}</pose><scale>1 1 1</scale><link name='link'>"
        f"<pose frame=''>{text}</pose><velocity>0 0 0 0 -0 0</velocity></link></model>"
        for i, text in enumerate(texts)
    )
    plane = "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>"
    return (
        "<?xml version='1.0'?><sdf version='1.6'><world name='default'><light name='sun' type='directional'/>"
        "<model name='ground_plane'><static>1</static><link name='link'>"
        f"<collision name='collision'>{plane}</collision></link></model>{models}"
        "<gravity>0 0 -9.8</gravity><state world_name='default'><sim_time>9 1</sim_time>"
        "<model name='ground_plane'><pose frame=''>0 0 0 0 -0 0</pose><link name='link'/></model>"
        f"{states}<light name='sun'/></state></world></sdf>"
    )


def world(*content: str) -> str:
    return f"<sdf version='1.7'><world name='w'>{''.join(content)}</world></sdf>"


def model(shape: str = BAR, *, name: str = "m", pose: str = "1 2 3 0 0 0") -> str:
    return (
        f"<model name='{name}'><pose>{pose}</pose><link name='l'><collision name='c'>{shape}</collision></link></model>"
    )


def loaded(tmp_path, text):
    path = tmp_path / "some.sdf"
    path.write_text(text, encoding="utf-8")
    return load_structure(path)


def test_a_world_like_the_original_has_its_21_bars_in_place(tmp_path):
    structure = loaded(tmp_path, original_world())
    expected = {(x, y, 10.0): 2 for x in (-1.9, 0.0, 1.9) for y in (-2.1, 0.0, 2.1)}
    beams = {(0.0, y, z): 0 for y in (-2.1, 0.0, 2.1) for z in (10.0, 11.9)}
    across = {(x, 0.0, z): 1 for x in (-1.9, 0.0, 1.9) for z in (10.0, 11.9)}
    centres = [tuple(bar.T_world_member.translation.tolist()) for bar in structure.members]
    assert sorted(centres) == sorted([*expected, *beams, *across])
    assert all(bar.solid == Box((0.2, 0.2, 4.0)) for bar in structure.members)
    assert (structure.name, structure.ground_z_m) == ("default", 0.0)
    assert [bar.name for bar in structure.members[:2]] == ["steel_bar_0", "steel_bar_1"]
    tilts_rad = []
    for bar in structure.members:  # the first nine are posts, then six along x, then six along y
        along = np.abs(bar.T_world_member.rotation[:, 2])
        axis = int(np.argmax(along))
        tilts_rad.append((axis, float(np.arccos(min(along[axis], 1.0)))))
    assert [axis for axis, _ in tilts_rad] == [2] * 9 + [0] * 6 + [1] * 6
    np.testing.assert_allclose([tilt for _, tilt in tilts_rad], [0.0] * 9 + [np.pi / 2 - 1.57] * 12, atol=1e-9)


def test_poses_of_model_link_and_shape_add_up_without_a_state(tmp_path):
    text = world(
        "<model name='a'><pose>1 0 0 0 0 1.5707963267948966</pose><link name='l'><pose>1 0 0 0 0 0</pose>"
        f"<collision name='c'><pose degrees='true'>0 0 1 0 90 0</pose>{BAR}</collision></link>"
        "<model name='b'><pose>0 1 0 0 0 0</pose><link name='l'><visual name='v'><geometry><cylinder>"
        "<radius>0.1</radius><length>2</length></cylinder></geometry></visual></link></model></model>"
    )
    bar, tube = loaded(tmp_path, text).members
    assert (bar.name, tube.name, tube.solid) == ("a", "a.b", Cylinder(0.1, 2.0))
    np.testing.assert_allclose(bar.T_world_member.translation, [1, 1, 1], atol=1e-15)
    np.testing.assert_allclose(bar.T_world_member.rotation[:, 2], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(tube.T_world_member.translation, [0, 0, 0], atol=1e-15)


def test_poses_in_the_state_are_those_of_the_world(tmp_path):
    state = (
        "<state world_name='w'><model name='m'><pose>5 0 0 0 0 0</pose><link name='l'><pose>7 0 0 0 0 0</pose></link>"
        "</model></state>"
    )
    (bar,) = loaded(tmp_path, world(model(), state)).members
    np.testing.assert_array_equal(bar.T_world_member.translation, [7, 0, 0])
    state = state.replace("<link name='l'><pose>7 0 0 0 0 0</pose></link>", "")
    (bar,) = loaded(tmp_path, world(model(), state)).members
    np.testing.assert_array_equal(bar.T_world_member.translation, [5, 0, 0])


def test_collision_shapes_go_before_visual_ones_and_several_get_longer_names(tmp_path):
    box = "<geometry><box><size>1 1 1</size></box></geometry>"
    text = (
        f"<sdf version='1.7'><model name='m'><link name='l'><visual name='v'>{BAR}</visual>"
        f"<collision name='c 1'>{box}</collision><collision name='c_1'>{box}</collision></link></model></sdf>"
    )
    structure = loaded(tmp_path, text)
    assert [(bar.name, bar.solid) for bar in structure.members] == [
        ("m.l.c_1", Box((1.0, 1.0, 1.0))),
        ("m.l.c_1_2", Box((1.0, 1.0, 1.0))),
    ]
    assert structure.ground_z_m is None


@pytest.mark.parametrize(
    "uri", ["part.ply", "file://{folder}/part.ply", "model://parts/part.ply", " model://{name}/part.ply\n"]
)
def test_meshes_are_found(tmp_path, uri, write_tetrahedron):
    for folder in (tmp_path, tmp_path / "parts"):
        folder.mkdir(exist_ok=True)
        write_tetrahedron(folder / "part.ply")
    uri = uri.format(folder=tmp_path, name=tmp_path.name)
    shape = f"<geometry><mesh><uri>{uri}</uri><scale>2 2 2</scale></mesh></geometry>"
    (part,) = loaded(tmp_path, world(model(shape))).members
    assert isinstance(part.solid, Mesh)
    assert (part.solid.scale, part.solid.vertices_m.max()) == ((2.0, 2.0, 2.0), 2.0)


STATE = "<state world_name='w'>{}</state>"
PLANE = "<geometry><plane><normal>{}</normal></plane></geometry>"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<sdf version='1.7'>", "not valid XML: no element found"),
        ("<!DOCTYPE sdf><sdf/>", "document type declaration"),
        ("<gazebo/>", "the root element must be <sdf>, is <gazebo>"),
        ("<sdf/>", "needs one <world> or one <model>, has 0 and 0"),
        (world("<include><uri>model://crane</uri></include>"), "<include> of 'model://crane' is not supported"),
        (world("<population/>"), "<population> is not supported"),
        (world(model(), model()), "model 'm': defined 2 times"),
        (world("<model/>"), "world: model: attribute 'name' is missing"),
        (world(model(pose="1 2 3")), "model 'm': pose: needs 6 finite numbers, got '1 2 3'"),
        (world(model(pose="1 2 nan 0 0 0")), "model 'm': pose: needs 6 finite numbers"),
        (world(model().replace("<pose>", "<pose relative_to='x'>")), "model 'm': pose: relative_to='x'"),
        (world(model().replace("<pose>", "<pose rotation_format='quat_xyzw'>")), "rotation_format 'quat_xyzw'"),
        (world(model().replace("<model ", "<model placement_frame='f' ")), "model 'm': placement_frame"),
        (world(model(), STATE.format("<model name='m'/>" * 2)), "state: model 'm': defined 2 times"),
        (world(model(), STATE.format("<model name='n'/>")), "state: model 'n': there is no such model"),
        (world(model(), STATE.format("<model name='m'><link name='k'/></model>")), "link 'k': there is no such link"),
        (world(model(), STATE.format("<insertions><model name='n'/></insertions>")), "state: <insertions> is not"),
        (
            world(model(), STATE.format("<model name='m'><scale>1 1 2</scale></model>")),
            "state: model 'm': scale must be 1 1 1, got '1 1 2'",
        ),
        (world(model("")), "model 'm': link 'l': collision 'c': <geometry> is missing"),
        (world(model("<geometry/>")), "collision 'c': geometry must be one element, is 0"),
        (world(model(BAR.replace("4.0", "-4"))), "collision 'c': box: size must be positive, got 0.2 0.2 -4"),
        (world(model(BAR.replace("4.0", "inf"))), "box: size: needs 3 finite numbers, got '0.2 0.2 inf'"),
        (world(model(BAR.replace("size", "sise"))), "box: <size> is missing"),
        (
            world(model("<geometry><cylinder><radius>0</radius><length>1</length></cylinder></geometry>")),
            "cylinder: radius must be positive, got 0",
        ),
        (world(model("<geometry><sphere/></geometry>")), "geometry must be a box, cylinder, mesh or plane, is sphere"),
        (world(model("<geometry><mesh/></geometry>")), "mesh: <uri> is missing"),
        (world(model("<geometry><mesh><uri>a.stl</uri></mesh></geometry>")), "a.stl: No such file"),
        (world(model("<geometry><mesh><uri>http://x/a.stl</uri></mesh></geometry>")), "not http://"),
        (world(model("<geometry><mesh><uri>model://p/a.stl</uri></mesh></geometry>")), "there is neither "),
        (world(model("<geometry><mesh><uri>a.dae</uri></mesh></geometry>")), "from .stl, .obj, .ply, not from '.dae'"),
        (world(model("<geometry><mesh><submesh/></mesh></geometry>")), "<submesh> is not supported"),
        (world(model(PLANE.format("1 0 0"))), "plane: only level planes are supported, the normal is 1 0 0"),
        (world(model(PLANE.format("0 0 0"))), "plane: only level planes"),
        (
            world(model(PLANE.format("0 0 1")), model(PLANE.format("0 0 1"), name="n", pose="0 0 1 0 0 0")),
            "ground planes at different heights: 1, 3 m",
        ),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, text, reason):
    with pytest.raises(InputFileError) as caught:
        loaded(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'some.sdf'}: ")
    assert reason in str(caught.value)


def test_a_file_that_is_nested_without_end_is_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"some\.sdf: models are nested too deeply"):
        loaded(tmp_path, world("<model name='a'>" * 5000, "</model>" * 5000))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (world(), "some.sdf: there is no box, cylinder or mesh in it"),
        (world(model(pose="0 0 2e6 0 0 0")), "some.sdf: member 'm': is 2e+06 m away, at most 1e+06 m is allowed"),
        (world(model(BAR.replace("4.0", "4000"))), "some.sdf: member 'm': size 0.2 0.2 4000 m is not between"),
        (world(model(), model(PLANE.format("0 0 1"), name="n", pose="0 0 2e6 0 0 0")), "some.sdf: ground at 2e+06 m"),
    ],
)
def test_what_is_beyond_limits_is_named(tmp_path, text, reason):
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, text)
    assert reason in str(caught.value)
