from services.planner.node import build_node
from shared.runtime.runner import run_service

run_service("planner", build_node)
