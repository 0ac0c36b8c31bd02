"""Writes a pcap of a made-up Ouster and its metadata: `python ouster_packets.py PCAP METADATA NUM_SCANS`.

Run by an interpreter that has ouster-sdk, and nothing of this project. Every beam has 5 m, but those of the top ring
nothing; scans are 0.1 s apart, columns 0.1 ms; the last scan lacks its first half.
"""

import sys
from pathlib import Path

import numpy as np
from ouster.sdk import core, pcap

FIRST_STAMP_NS = 1_650_408_693_802_616_001


def packets(info, num_scans):
    frame = core.LidarFrame(info)
    columns = np.arange(frame.w)
    frame.field("RANGE")[:] = 5000
    frame.field("RANGE")[0] = 0
    frame.field("REFLECTIVITY")[:] = 77
    frame.status[:] = 1
    frame.measurement_id[:] = columns
    for i in range(num_scans):
        frame.frame_id = i
        frame.timestamp[:] = FIRST_STAMP_NS + i * 100_000_000 + columns * 100_000
        made = core.frame_to_packets(frame, core.PacketFormat.from_info(info), 0, 0)
        yield from made if i < num_scans - 1 else made[len(made) // 2 :]


if __name__ == "__main__":
    metadata = core.SensorInfo.from_default(core.LidarMode._1024x10)
    metadata.config.udp_port_lidar, metadata.config.udp_port_imu = 7502, 7503
    Path(sys.argv[2]).write_text(metadata.to_json_string())
    pcap.record(packets(metadata, int(sys.argv[3])), sys.argv[1])
