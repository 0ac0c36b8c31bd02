import sys
from functools import partial

from services.teleop.node import build_node
from shared.runtime.runner import run_service, service_parser

arguments = service_parser("teleop").parse_args()
run_service("teleop", partial(build_node, sys.argv[1:]), arguments)
