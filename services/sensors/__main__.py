from functools import partial
from pathlib import Path

from services.sensors.sources.node import SourceOptions, source_builder
from shared.runtime.runner import run_service, service_parser

parser = service_parser("sensors")
parser.add_argument("--sensor", default="lidar", metavar="NAME", help="which of the configured sensors this process is")
source = parser.add_argument_group("a real sensor in its place")
source.add_argument("--source", type=Path, metavar="FILE", help="recording to play: Ouster pcap, MCAP, rosbag2 folder")
source.add_argument("--metadata", type=Path, metavar="FILE", help="of the pcap; else the .json beside it")
source.add_argument("--topic", metavar="NAME", help="topic of the clouds or depth images, where there are several")
arguments = parser.parse_args()
if arguments.source is not None:
    options = SourceOptions(arguments.source, arguments.metadata, arguments.topic)
    run_service(arguments.sensor, source_builder(arguments.sensor, options), arguments)
else:
    from services.sensors.node import build_node  # what simulates sensors: not needed by those who play a recording

    run_service(arguments.sensor, partial(build_node, arguments.sensor), arguments)
