"""Small good inputs of every reader: what mutations begin with."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from services.recorder.ros.messages import to_cdr
from shared.cloud_files import write_cloud, write_scan
from shared.meshes import box
from shared.messaging.channels import CHANNELS, LIDAR_POINTS
from shared.messaging.codec import encode, to_jsonable
from shared.messaging.messages import LidarScan, Message
from shared.runtime.config import CONFIGS_DIR
from shared.world.files import load_structure, save_structure
from shared.world.structure import Structure
from tests.support import bags
from tests.support.examples import EXAMPLES
from tests.support.recordings import URDF

FAR = np.full(8, 1e9)
COMMANDS: tuple[type[Message], ...] = tuple(dict.fromkeys(of.message for of in CHANNELS if of.is_command))
MESSAGES: tuple[type[Message], ...] = tuple(dict.fromkeys(type(example) for example in EXAMPLES))
_STAMP_NS = 10**9


def payloads() -> list[bytes]:
    """Each behind the number of its type."""
    return [bytes([MESSAGES.index(type(example))]) + encode(example) for example in EXAMPLES]


def commands() -> list[bytes]:
    """As MessagePack, as JSON and as what people type, each behind the number of its type."""
    found = [example for example in EXAMPLES if type(example) in COMMANDS]
    packed = [bytes([COMMANDS.index(type(example))]) + encode(example) for example in found]
    typed = [bytes([COMMANDS.index(type(example))]) + _json(example) for example in found]
    return [*packed, *typed, *(bytes([number]) + b"A" for number in range(len(COMMANDS)))]


def typed() -> list[bytes]:
    """What the zenoh CLI shows, each behind the number of its channel."""
    by_type = {type(example): encode(example) for example in EXAMPLES}
    return [bytes([number]) + by_type[channel.message] for number, channel in enumerate(CHANNELS)]


def cdr() -> list[bytes]:
    """As they stand in recordings, each behind the number of its channel."""
    by_type: dict[type[Message], Message] = {type(example): example for example in EXAMPLES}
    return [
        bytes([number]) + bytes(to_cdr(by_type[channel.message], _STAMP_NS)[1])
        for number, channel in enumerate(CHANNELS)
    ]


def settings() -> list[bytes]:
    """Of `--set`."""
    return [b"seed=3", b"mapper.crop_m=[0, 1, 0, 1, 0, 1]", b"sim.slip={turn_deg: 1}", b"recorder.channels=[tf]"]


def configs() -> list[bytes]:
    """Configuration files."""
    return [b"seed: 3\nsim: {mode: dynamic, slip: &a {slide_m: 0.1}}\nmapper:\n  crop_m: [0, 1, 0, 1, 0, 1]\n"]


def sweeps() -> list[bytes]:
    """Specifications of sweeps."""
    return [b"data: [a]\nmethods: [gicp, plane]\nvoxels: [0.05]\nset: [mapper.deskew=false]\n"]


def beams() -> list[bytes]:
    """Tables of beams."""
    return [path.read_bytes() for path in sorted((CONFIGS_DIR / "sensors" / "beams").glob("*.yaml"))]


def ouster_metadata() -> list[bytes]:
    """Of a sensor, in the old flat form."""
    metadata = {
        "beam_altitude_angles": np.linspace(20, -20, 128).round(2).tolist(),
        "beam_azimuth_angles": [0.0] * 128,
        "lidar_origin_to_beam_origin_mm": 15.8,
        "lidar_to_sensor_transform": np.diag([-1.0, -1, 1, 1]).ravel().tolist(),
    }
    return [json.dumps(metadata).encode(), json.dumps({"beam_intrinsics": metadata}).encode()]


def trajectories() -> list[bytes]:
    """A climb with its changes of foot."""
    return [b"q1,q2,q3,q4,q5,q6,q7,q8\n0,0,0,0,0,0,0,0\nC,C,C,C,C,C,C,C\n-0.6,0,0.6,0,0,0.6,0,-0.6\n"]


def postures() -> list[bytes]:
    """Named postures."""
    return [(CONFIGS_DIR / "postures.csv").read_bytes()]


def tum() -> list[bytes]:
    """Stamped poses."""
    return [b"# t x y z qx qy qz qw\n0.1 0 0 0 0 0 0 1\n1e0 1 2 3 0 0.6 0 0.8\n"]


def pcd() -> list[bytes]:
    """Binary, ascii, and a scan."""
    ascii_pcd = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA "
    scan = next(example for example in EXAMPLES if isinstance(example, LidarScan))
    compressed = np.array([25, 24], "<u4").tobytes() + bytes([23]) + bytes(24)
    return [
        *_clouds(".pcd"),
        ascii_pcd + b"ascii\n1 2 3\n4 5 nan\n",
        ascii_pcd + b"binary_compressed\n" + compressed,
        _written(lambda path: write_scan(path, scan), ".pcd"),
    ]


def ply() -> list[bytes]:
    """Clouds, binary and ascii."""
    head = (
        b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    return [*_clouds(".ply"), head + b"1 2 3\n4 5 6\n"]


def las() -> list[bytes]:
    """Clouds."""
    return _clouds(".las")


def stl() -> list[bytes]:
    """A bar, binary; a triangle, ascii."""
    bar = load_structure(CONFIGS_DIR / "structures" / "original.yaml")
    one = Structure(bar.name, bar.members[:1], None)
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    return [_written(lambda path: save_structure(one, path), ".stl"), b"solid a\n" + facet + b"endsolid a\n"]


def obj() -> list[bytes]:
    """A triangle and a quad, with what else stands in such files."""
    vertices = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\n"
    return [b"mtllib a.mtl\no a\n" + vertices + b"usemtl m\nf 1/1/1 2//1 3\nf -1 2 3 1\n"]


def ply_mesh() -> list[bytes]:
    """A triangle, ascii and binary."""
    head = (
        b"ply\nformat %s 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    corners = box([1, 1, 1]).vertices_m[:3].astype("<f4").tobytes()
    binary = corners + b"\x03" + np.array([0, 1, 2], "<i4").tobytes()
    return [head % b"ascii" + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", head % b"binary_little_endian" + binary]


def structure_yaml() -> list[bytes]:
    """Bars, plates, tubes; the shipped structure."""
    small = b"name: s\nground_z_m: 0\nbars:\n- &a {name: a, centre_m: [0, 0, 1], size_m: [1, 1, 1]}\ntubes: []\n"
    return [small, (CONFIGS_DIR / "structures" / "original.yaml").read_bytes()]


def sdf() -> list[bytes]:
    """A world with a state, a ground plane and a box."""
    box_sdf = "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision>"
    plane = "<collision name='c'><geometry><plane><normal>0 0 1</normal></plane></geometry></collision>"
    models = f"<model name='g'><link name='l'>{plane}</link></model>"
    models += f"<model name='b'><pose>0 0 1 0 0 0</pose><link name='l'>{box_sdf}</link></model>"
    link = "<link name='l'><pose>1 0 1 0 0 0</pose></link>"
    state = f"<state world_name='w'><model name='b'><pose>1 0 1 0 0 1.57</pose>{link}</model></state>"
    return [f"<sdf version='1.6'><world name='w'>{models}{state}</world></sdf>".encode()]


def urdf() -> list[bytes]:
    """Links and a joint."""
    shape = "<visual><origin xyz='0 0 1' rpy='0 0 1'/><geometry><box size='1 1 1'/></geometry></visual>"
    inertial = "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
    joint = "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/>"
    joint += "<limit lower='-1' upper='1' velocity='1' effort='1'/></joint>"
    links = f"<link name='a'>{shape}{inertial}</link><link name='b'>{shape.replace('visual', 'collision')}</link>"
    return [URDF.encode(), f"<robot name='r'>{links}{joint}</robot>".encode()]


def recordings() -> list[bytes]:
    """Of our own channels: compressed, and without checksums, so that what is changed in a chunk is read."""
    scan = next(example for example in EXAMPLES if isinstance(example, LidarScan))
    said = LIDAR_POINTS.topic, LIDAR_POINTS.ros_type, bytes(to_cdr(scan, _STAMP_NS)[1])
    return [_mcap(*said, compression) for compression in CompressionType]


def ros_recordings() -> list[bytes]:
    """Of a ROS sensor."""
    table = np.zeros(4, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"), ("t", "<u4")])
    table["x"], table["t"] = 1, np.arange(4)
    said = [("/points", bags.cloud(table, _STAMP_NS)), ("/imu", bags.imu((0, 0, 0), (0, 0, 9.81), _STAMP_NS))]
    cloud = said[0][1]
    plain = bytes(bags.STORE.serialize_cdr(cloud, cloud.__msgtype__))
    recording = _mcap("/points", cloud.__msgtype__, plain, CompressionType.NONE)
    return [_written(lambda path: bags.write_mcap(path, said), ".mcap"), recording]


def _mcap(topic: str, ros_type: str, data: bytes, compression: CompressionType) -> bytes:
    """Two messages; what is not compressed has no checksum either, so that what is changed in it is read."""
    file = BytesIO()
    writer = Writer(file, compression=compression, enable_crcs=compression is not CompressionType.NONE)
    writer.start(profile="ros2")
    schema = writer.register_schema(ros_type, "ros2msg", b"")
    channel = writer.register_channel(topic, "cdr", schema)
    writer.add_metadata("hyrecro_run", {"version": "1"})
    writer.add_metadata("hyrecro_counts", {topic: '{"num_received": 1, "num_written": 1}'})
    for number in range(2):
        writer.add_message(channel, _STAMP_NS, data, _STAMP_NS, number)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def _clouds(suffix: str) -> list[bytes]:
    points_m = np.arange(12.0).reshape(4, 3)
    colours = np.full((4, 3), 7, dtype=np.uint8)
    return [_written(partial(_write_cloud, points_m, of), suffix) for of in (None, colours)]


def _write_cloud(points_m: NDArray[np.float64], colours: NDArray[np.uint8] | None, path: Path) -> None:
    write_cloud(path, points_m, colours)


def _written(write: Callable[[Path], object], suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"example{suffix}"
        write(path)
        return path.read_bytes()


def _json(message: Message) -> bytes:
    return json.dumps({name: value for name, value in to_jsonable(message).items() if value is not None}).encode()
