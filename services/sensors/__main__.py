from functools import partial

from services.sensors.node import build_node
from shared.runtime.runner import run_service, service_parser

parser = service_parser("sensors")
parser.add_argument("--sensor", default="lidar", metavar="NAME", help="which of the configured sensors this process is")
arguments = parser.parse_args()
run_service(arguments.sensor, partial(build_node, arguments.sensor), arguments)
