"""The queues of Zenoh's links, as settings: how much room there is, and how long who finds none waits for it."""

from __future__ import annotations

BATCH_BYTES = 65_535
"""Of one batch, the largest there is. What fits into it needs no shared memory: who says nothing larger has no pool."""
IMPLICIT_SHARED_MEMORY = "transport/shared_memory/transport_optimization/enabled"
"""Setting: whether Zenoh puts large messages into shared memory by itself."""
ROUTER_RUNTIME = "(rx: (worker_threads: 8))"
"""Threads on which the router reads: a large message may wait 50 ms for room, on the thread that read it."""
_NUM_BATCHES = 16
"""The most that Zenoh allows for a link and priority; its default is 2."""
_PRIORITIES = ("interactive_high", "data", "data_low")
_DROP_AFTER_US = 50_000
"""How long a small LATEST message may wait for room to the router before it is dropped: half a LiDAR period."""
_ROUTER_DROP_AFTER_US = 1_000
"""The same on its way from the router, where whoever waits holds up all that its sender says to others."""
_ROUTER_CLOSE_AFTER_US = 1_000_000
"""How long an EVERY message may find no room on its way from the router before that subscriber is cut off."""
_QUEUE = "transport/link/tx/queue"


def queues_of_client() -> dict[str, int]:
    """Settings of a session, by path."""
    return _queues(_DROP_AFTER_US)


def queues_of_router() -> dict[str, int]:
    """Settings of the router, by path; those of docker-compose.yml stand in configs/zenoh/router.json5."""
    return _queues(_ROUTER_DROP_AFTER_US) | {
        f"{_QUEUE}/congestion_control/block/wait_before_close": _ROUTER_CLOSE_AFTER_US
    }


def _queues(drop_after_us: int) -> dict[str, int]:
    sizes = {f"{_QUEUE}/size/{priority}": _NUM_BATCHES for priority in _PRIORITIES}
    return sizes | {f"{_QUEUE}/congestion_control/drop/wait_before_drop": drop_after_us}
