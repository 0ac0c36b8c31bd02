"""Reads structures from SDF, the format of Gazebo's worlds and models (http://sdformat.org/spec, versions 1.4 to 1.9).

Where models stand: Gazebo saves the poses that count in the world's <state>, all of them in the world frame, and leaves
others in the models. Angles are taken as they are written: 1.57 is not pi / 2.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from shared.errors import InputFileError
from shared.files import read_text
from shared.geometry import SE3
from shared.mesh_files import mesh_path, read_mesh
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure, unique_names
from shared.xml_reading import (
    XmlError,
    all_positive,
    attribute,
    child_of,
    finite_numbers,
    refuse_duplicates,
    root_of,
)

_LEVEL_TOLERANCE = 1e-3
"""How far the normal of a ground plane may lean, in radians; more than 1.57 for pi / 2 makes of it."""


@dataclass(slots=True)
class _Found:
    """What was found so far: solids by the names of model and then of link and shape; heights of ground planes."""

    folder: Path
    solids: list[tuple[str, str, Box | Cylinder | Mesh, SE3]] = field(default_factory=list)
    ground_z_m: list[float] = field(default_factory=list)


def read_sdf_structure(path: Path) -> Structure:
    """The structure of an SDF file: every model of its world, or its one model; level planes are the ground.

    Of each link the collision shapes count, or the visual ones where there are none. A member has the name of its
    model; if the model has several shapes also those of link and shape.

    Raises:
        InputFileError: naming file, element and reason; also for what the format has and this reader has not.
    """
    text = read_text(path)
    try:
        return _structure(root_of(text, "sdf"), path)
    except XmlError as error:
        raise InputFileError(f"{path}: {error}") from error
    except RecursionError:
        raise InputFileError(f"{path}: models are nested too deeply") from None


def _structure(sdf: ET.Element, path: Path) -> Structure:
    worlds, models = sdf.findall("world"), sdf.findall("model")
    if len(worlds) + len(models) != 1:
        raise XmlError(f"needs one <world> or one <model>, has {len(worlds)} and {len(models)}")
    found = _Found(path.parent)
    if worlds:
        _add_models(worlds[0], worlds[0].find("state"), SE3.identity(), "", found)
    else:
        _add_models(sdf, None, SE3.identity(), "", found)
    if len(set(found.ground_z_m)) > 1:
        heights = ", ".join(f"{z:g}" for z in sorted(set(found.ground_z_m)))
        raise XmlError(f"ground planes at different heights: {heights} m; one is allowed")
    counts = Counter(model for model, *_ in found.solids)
    names = unique_names(model if counts[model] == 1 else f"{model}.{shape}" for model, shape, *_ in found.solids)
    members = (Member(name, solid, T) for name, (_, _, solid, T) in zip(names, found.solids, strict=True))
    (name,) = unique_names([(worlds or models)[0].get("name") or path.stem])
    return Structure(name, tuple(members), found.ground_z_m[0] if found.ground_z_m else None)


def _add_models(parent: ET.Element, state: ET.Element | None, T_world_parent: SE3, path: str, found: _Found) -> None:
    for include in parent.findall("include"):
        uri = include.findtext("uri", "").strip()
        raise XmlError(f"<include> of '{uri}' is not supported: put that model into this file")
    for tag in ("population", "actor"):
        if parent.find(tag) is not None:
            raise XmlError(f"<{tag}> is not supported")
    for change in ("insertions", "deletions"):
        if state is not None and len(state.find(change) or ()) > 0:
            raise XmlError(f"state: <{change}> is not supported: save the world again with them done")
    models = parent.findall("model")
    states = _states_by_name(state, "model", models)
    for model in models:
        name = attribute(model, "name", f"{path or 'world'}: model")
        _add_model(model, states.get(name), T_world_parent, f"{path}.{name}" if path else name, found)


def _add_model(model: ET.Element, state: ET.Element | None, T_world_parent: SE3, path: str, found: _Found) -> None:
    where = f"model '{path}'"
    if model.get("placement_frame"):
        raise XmlError(f"{where}: placement_frame is not supported")
    T_world_model = T_world_parent @ _pose(model, where)
    if state is not None:
        _refuse_scale(state, f"state: {where}")
        T_world_model = _pose(state, f"state: {where}", T_world_model)
    links = model.findall("link")
    states = _states_by_name(state, "link", links, f"{where}: ")
    for link in links:
        name = attribute(link, "name", f"{where}: link")
        at = f"{where}: link '{name}'"
        T_world_link = T_world_model @ _pose(link, at)
        if name in states:
            T_world_link = _pose(states[name], f"state: {at}", T_world_link)
        for shape in link.findall("collision") or link.findall("visual"):
            shape_name = attribute(shape, "name", f"{at}: {shape.tag}")
            shape_at = f"{at}: {shape.tag} '{shape_name}'"
            _add_shape(shape, T_world_link @ _pose(shape, shape_at), shape_at, (path, f"{name}.{shape_name}"), found)
    _add_models(model, state, T_world_model, path, found)


def _states_by_name(
    state: ET.Element | None, tag: str, elements: list[ET.Element], where: str = ""
) -> dict[str, ET.Element]:
    """The states of models or links by name; each must be of one that is there."""
    names = [element.get("name", "") for element in elements]
    refuse_duplicates(f"{where}{tag}", names)
    states = [] if state is None else state.findall(tag)
    refuse_duplicates(f"state: {where}{tag}", [element.get("name", "") for element in states])
    for element in states:
        if element.get("name") not in names:
            raise XmlError(f"state: {where}{tag} '{element.get('name', '')}': there is no such {tag}")
    return {element.get("name", ""): element for element in states}


def _refuse_scale(state: ET.Element, where: str) -> None:
    text = state.findtext("scale")
    if text is not None and finite_numbers(text, 3, f"{where}: scale") != [1.0, 1.0, 1.0]:
        raise XmlError(f"{where}: scale must be 1 1 1, got '{text.strip()}': write the true sizes into the model")


def _pose(element: ET.Element, where: str, default: SE3 | None = None) -> SE3:
    """The transform of the element's <pose>, x y z roll pitch yaw; `default` or none where there is no such child."""
    pose = element.find("pose")
    if pose is None:
        return SE3.identity() if default is None else default
    for key in ("relative_to", "frame"):
        if pose.get(key):
            raise XmlError(f"{where}: pose: {key}='{pose.get(key)}' is not supported")
    if pose.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise XmlError(f"{where}: pose: rotation_format '{pose.get('rotation_format')}' is not supported")
    if not (pose.text or "").strip():
        return SE3.identity()
    values = np.array(finite_numbers(pose.text or "", 6, f"{where}: pose"))
    in_degrees = pose.get("degrees") in ("true", "1")
    return SE3.from_rpy(np.deg2rad(values[3:]) if in_degrees else values[3:], values[:3])


def _add_shape(shape: ET.Element, T_world_shape: SE3, where: str, names: tuple[str, str], found: _Found) -> None:
    geometries = list(child_of(shape, "geometry", where))
    if len(geometries) != 1:
        raise XmlError(f"{where}: geometry must be one element, is {len(geometries)}")
    geometry = geometries[0]
    at = f"{where}: {geometry.tag}"
    solid: Box | Cylinder | Mesh
    match geometry.tag:
        case "empty":
            return
        case "plane":
            found.ground_z_m.append(_plane_z_m(geometry, T_world_shape, at))
            return
        case "box":
            x, y, z = all_positive(_numbers(geometry, "size", 3, at), f"{at}: size")
            solid = Box((x, y, z))
        case "cylinder":
            radius, length = (
                all_positive(_numbers(geometry, key, 1, at), f"{at}: {key}")[0] for key in ("radius", "length")
            )
            solid = Cylinder(radius, length)
        case "mesh":
            solid = _mesh(geometry, at, found.folder)
        case tag:
            raise XmlError(f"{where}: geometry must be a box, cylinder, mesh or plane, is {tag}")
    found.solids.append((*names, solid, T_world_shape))


def _plane_z_m(plane: ET.Element, T_world_plane: SE3, where: str) -> float:
    normal = np.array(_numbers(plane, "normal", 3, where) if plane.find("normal") is not None else [0.0, 0.0, 1.0])
    x, y, z = (T_world_plane.rotation @ normal).tolist()
    if math.hypot(x, y) >= _LEVEL_TOLERANCE * z:
        raise XmlError(f"{where}: only level planes are supported, the normal is {x:g} {y:g} {z:g} in the world")
    return float(T_world_plane.translation[2])


def _mesh(element: ET.Element, where: str, folder: Path) -> Mesh:
    if element.find("submesh") is not None:
        raise XmlError(f"{where}: <submesh> is not supported")
    x, y, z = _numbers(element, "scale", 3, where) if element.find("scale") is not None else (1.0, 1.0, 1.0)
    try:
        return read_mesh(_resolved(child_of(element, "uri", where).text or "", folder), (x, y, z))
    except (ValueError, InputFileError) as error:
        raise XmlError(f"{where}: {error}") from error


def _resolved(uri: str, folder: Path) -> Path:
    """model://NAME/... is looked for beside the file, then beside its folder, as if that were a model's."""
    uri = uri.strip()
    if not uri.startswith("model://"):
        return mesh_path(uri, folder)
    places = [(base / uri.removeprefix("model://")).resolve() for base in (folder, folder.parent)]
    for place in places:
        if place.is_file():
            return place
    raise ValueError(f"'{uri}': there is neither {places[0]} nor {places[1]}")


def _numbers(element: ET.Element, tag: str, count: int, where: str) -> list[float]:
    return finite_numbers(child_of(element, tag, where).text or "", count, f"{where}: {tag}")
