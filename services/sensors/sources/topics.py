"""Which topics of a recording stand for a sensor."""

from __future__ import annotations

from collections.abc import Mapping

from shared.errors import InputFileError

POINTS = "sensor_msgs/msg/PointCloud2"
IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
IMU = "sensor_msgs/msg/Imu"
_MAIN = {"lidar": POINTS, "depth": IMAGE}


def choose_topics(types: Mapping[str, str], kind: str, wanted: str | None) -> list[str]:
    """The topics to play for a sensor of a kind, out of topic -> type; the first one is that of its scans or images.

    wanted: which one that is; None = the only one of its type, or the only image with `depth` in its name. With it
    come the camera info beside a depth image, or else the only one, and the only IMU.

    Raises:
        InputFileError: no such topic, or several; it says which ones there are.
    """
    main = _main_topic(types, _MAIN[kind], wanted)
    infos = _camera_info(types, main) if kind == "depth" else []
    imus = _of(types, IMU)
    return [main, *infos, *(imus if len(imus) == 1 else [])]


def _main_topic(types: Mapping[str, str], ros_type: str, wanted: str | None) -> str:
    candidates = _of(types, ros_type)
    if wanted is not None:
        if wanted not in candidates:
            raise InputFileError(f"no topic {wanted} of {ros_type}; {_listed(types)}")
        return wanted
    if ros_type == IMAGE and len(candidates) > 1:
        candidates = [topic for topic in candidates if "depth" in topic] or candidates
    if not candidates:
        raise InputFileError(f"no topic of {ros_type}; {_listed(types)}")
    if len(candidates) > 1:
        raise InputFileError(f"several topics of {ros_type}: {', '.join(candidates)}; --topic NAME chooses one")
    return candidates[0]


def _camera_info(types: Mapping[str, str], image: str) -> list[str]:
    """By the convention of image_transport it stands beside the image."""
    infos = _of(types, CAMERA_INFO)
    beside = f"{image.rpartition('/')[0]}/camera_info"
    if beside in infos:
        return [beside]
    return infos if len(infos) == 1 else []


def _of(types: Mapping[str, str], ros_type: str) -> list[str]:
    return sorted(topic for topic, of_type in types.items() if of_type == ros_type)


def _listed(types: Mapping[str, str]) -> str:
    return "it has " + (", ".join(f"{topic} ({types[topic]})" for topic in sorted(types)) or "none at all")
