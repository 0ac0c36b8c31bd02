from services.sensors.node import SENSORS
from shared.runtime.runner import run_service, service_parser

parser = service_parser("sensors")
parser.add_argument("--sensor", choices=sorted(SENSORS), default="lidar", help="which sensor this process is")
arguments = parser.parse_args()
run_service(arguments.sensor, SENSORS[arguments.sensor], arguments)
