"""The readers, each as a function of bytes that reads them or raises an error that this project raises on purpose."""

from __future__ import annotations

import atexit
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cli.sweep_spec import read_spec
from fuzz import examples
from services.player.trajectory import read_trajectory
from services.recorder.bag.file_order import FileOrderReading
from services.recorder.bag.overview import overview_of
from services.recorder.bag.recording import Recording
from services.recorder.bag.recovery import recover
from services.recorder.bag.verification import verified
from services.recorder.ros.reading import from_cdr
from services.sensors.lidar.beam_files import read_beams
from services.sensors.sources.ros_recording import read_bag
from services.teleop.postures import read_postures
from shared.cloud_files import read_cloud
from shared.errors import HyrecroError
from shared.mesh_files import read_mesh
from shared.messaging.channels import CHANNELS
from shared.messaging.codec import decode, decode_command, encode, from_text, to_text
from shared.messaging.fields import specs_of
from shared.runtime.config_loading import load_config
from shared.trajectory_files import read_tum
from shared.world.files import load_structure

_LIMITS = (-examples.FAR, examples.FAR)


@dataclass(frozen=True, slots=True)
class Target:
    """One reader. examples: what it can read, to begin with. max_bytes: of what it is given."""

    read: Callable[[bytes], object]
    examples: Callable[[], list[bytes]]
    max_bytes: int = 4096

    def run(self, data: bytes) -> bool:
        """Whether the bytes could be read; what else goes wrong than a refusal is a finding, and raised."""
        try:
            self.read(data)
        except HyrecroError as error:
            str(error).encode()  # what people are told can be sent and written
            return False
        return True


def _decoded(data: bytes) -> None:
    """The first byte chooses the message; what is read can be sent on, and is then the same."""
    message_type = examples.MESSAGES[data[0] % len(examples.MESSAGES)] if data else examples.MESSAGES[0]
    message = decode(message_type, data[1:])
    assert decode(message_type, encode(message)) == message


def _commanded(data: bytes) -> None:
    message_type = examples.COMMANDS[data[0] % len(examples.COMMANDS)] if data else examples.COMMANDS[0]
    message = decode_command(message_type, data[1:])
    assert decode_command(message_type, encode(message)) == message
    assert specs_of(message_type)


def _typed(data: bytes) -> None:
    """What the zenoh CLI shows, and what it sends."""
    channel = CHANNELS[data[0] % len(CHANNELS)] if data else CHANNELS[0]
    try:
        to_text(channel.key_expr, data[1:])
    except HyrecroError:
        from_text(channel.key_expr, os.fsdecode(data[1:]))


def _recorded(data: bytes) -> None:
    channel = CHANNELS[data[0] % len(CHANNELS)] if data else CHANNELS[0]
    from_cdr(channel, data[1:], 0)


def _set(data: bytes) -> None:
    """On the shortest configuration: the default takes fifty times as long to read."""
    load_config(Path("original"), overrides=[os.fsdecode(data)])


def _file(read: Callable[[Path], object], suffix: str) -> Callable[[bytes], object]:
    """A reader of files; the file stands in memory where the system has such a folder."""
    memory = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it
    folder = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    path = Path(folder.name) / f"given{suffix}"
    atexit.register(folder.cleanup)

    def read_file(data: bytes) -> object:
        path.write_bytes(data)
        return read(path)

    return read_file


def _any_way(path: Path) -> None:
    """A recording that may be damaged."""
    overview_of(path)
    verified(path)
    out = path.with_name("recovered.mcap")
    out.unlink(missing_ok=True)
    recover(path, out)


def _in_order(path: Path) -> None:
    for _ in FileOrderReading(path).messages(lambda _channel, _stamp_ns: True):
        pass


def _in_time(path: Path) -> None:
    recording = Recording(path)
    assert recording.topics() is not None
    readable = [channel for channel in CHANNELS if channel.is_recorded]
    for _ in recording.messages(*readable):
        pass


def _played(path: Path) -> None:
    for _ in read_bag(path, "lidar", None, "lidar"):
        pass


TARGETS: dict[str, Target] = {
    "codec": Target(_decoded, examples.payloads),
    "command": Target(_commanded, examples.commands),
    "zenoh_cli": Target(_typed, examples.typed),
    "cdr": Target(_recorded, examples.cdr),
    "setting": Target(_set, examples.settings, 256),
    "config": Target(_file(load_config, ".yaml"), examples.configs),
    "sweep": Target(_file(read_spec, ".yaml"), examples.sweeps),
    "beams": Target(_file(lambda path: read_beams(path, 512), ".yaml"), examples.beams, 8192),
    "ouster_metadata": Target(_file(lambda path: read_beams(path, 512), ".json"), examples.ouster_metadata, 8192),
    "trajectory": Target(_file(read_trajectory, ".csv"), examples.trajectories),
    "postures": Target(_file(lambda path: read_postures(path, *_LIMITS), ".csv"), examples.postures),
    "tum": Target(_file(read_tum, ".tum"), examples.tum),
    "pcd": Target(_file(read_cloud, ".pcd"), examples.pcd),
    "ply": Target(_file(read_cloud, ".ply"), examples.ply),
    "las": Target(_file(read_cloud, ".las"), examples.las),
    "stl": Target(_file(read_mesh, ".stl"), examples.stl),
    "obj": Target(_file(read_mesh, ".obj"), examples.obj),
    "ply_mesh": Target(_file(read_mesh, ".ply"), examples.ply_mesh),
    "structure_yaml": Target(_file(load_structure, ".yaml"), examples.structure_yaml),
    "sdf": Target(_file(load_structure, ".sdf"), examples.sdf),
    "urdf": Target(_file(load_structure, ".urdf"), examples.urdf),
    "mcap": Target(_file(_any_way, ".mcap"), examples.recordings, 16384),
    "mcap_in_order": Target(_file(_in_order, ".mcap"), examples.recordings, 16384),
    "mcap_in_time": Target(_file(_in_time, ".mcap"), examples.recordings, 16384),
    "mcap_of_ros": Target(_file(_played, ".mcap"), examples.ros_recordings, 16384),
}
