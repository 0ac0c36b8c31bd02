from services.sim.node import build_node
from shared.runtime.runner import run_service

run_service("sim", build_node)
