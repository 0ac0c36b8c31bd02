from services.recorder.node import build_node
from shared.runtime.runner import run_service

run_service("recorder", build_node)
