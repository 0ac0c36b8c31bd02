from services.evaluator.node import build_node
from shared.runtime.runner import run_service

run_service("evaluator", build_node)
