from services.player.node import build_node
from shared.runtime.runner import run_service

run_service("player", build_node)
