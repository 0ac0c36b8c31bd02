from services.mapper.node import build_node
from shared.runtime.runner import run_service

run_service("mapper", build_node)
