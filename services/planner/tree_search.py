"""Finds a way round obstacles in joint space: two trees that grow towards each other, then shortcuts.

Source: Kuffner & LaValle, RRT-Connect, 2000; shortcuts as in Geraerts & Overmars, Creating high-quality paths, 2007.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shared.geometry import Float

IsWayFree = Callable[[Float, Float], bool]


class _Tree:
    """Postures and where each was reached from; several roots are allowed."""

    def __init__(self, roots: Float, scale: Float) -> None:
        self._scale = scale
        self.nodes: list[Float] = list(roots)
        self._parents: list[int] = [-1] * len(roots)

    def nearest(self, q: Float) -> int:
        away = (np.array(self.nodes) - q) / self._scale
        return int((away**2).sum(axis=1).argmin())

    def add(self, q: Float, parent: int) -> int:
        self.nodes.append(q)
        self._parents.append(parent)
        return len(self.nodes) - 1

    def grow(self, q: Float, parent: int, step: float, is_way_free: IsWayFree) -> tuple[int, bool]:
        """Towards q by as many steps as are free; the last node, and whether it is q."""
        while True:
            start = self.nodes[parent]
            distance = float(np.linalg.norm((q - start) / self._scale))
            is_last = distance <= step
            q_next = q if is_last else start + step / distance * (q - start)
            if not is_way_free(start, q_next):
                return parent, False
            parent = self.add(q_next, parent)
            if is_last:
                return parent, True

    def path_to(self, node: int) -> list[Float]:
        path = []
        while node >= 0:
            path.append(self.nodes[node])
            node = self._parents[node]
        return path[::-1]


def find_path(
    start: Float,
    goals: Float,
    scale: Float,
    is_way_free: IsWayFree,
    draw: Callable[[], Float],
    max_iterations: int,
    step: float = 0.4,
) -> Float | None:
    """Free postures (N, 8) from start (8,) to one of goals (K, 8), or None after `max_iterations`.

    scale (8,): joint distances are divided by it, `step` is the longest piece in these units. draw: a random posture.
    """
    trees = (_Tree(start[None], scale), _Tree(goals, scale))
    for iteration in range(max_iterations):
        ahead, other = trees if iteration % 2 == 0 else trees[::-1]
        q = draw()
        parent = ahead.nearest(q)
        away = float(np.linalg.norm((q - ahead.nodes[parent]) / scale))
        q = ahead.nodes[parent] + min(1.0, step / max(away, 1e-12)) * (q - ahead.nodes[parent])
        if not is_way_free(ahead.nodes[parent], q):
            continue
        node = ahead.add(q, parent)
        met, is_met = other.grow(q, other.nearest(q), step, is_way_free)
        if is_met:
            first, second = ahead.path_to(node), other.path_to(met)[::-1]
            path = first + second[1:] if iteration % 2 == 0 else second[::-1] + first[::-1][1:]
            return np.array(path)
    return None


def shortened(path: Float, is_way_free: IsWayFree, rng: np.random.Generator, num_tries: int) -> Float:
    """The path (N, 8) with detours cut off: same ends, no new collisions."""
    points = list(path)
    for _ in range(num_tries):
        if len(points) <= 2:
            break
        i, j = sorted(rng.uniform(0, len(points) - 1, 2))
        a, b = int(i), int(j)
        if a == b:
            continue
        q_a = points[a] + (i - a) * (points[a + 1] - points[a])
        q_b = points[b] + (j - b) * (points[b + 1] - points[b])
        if is_way_free(q_a, q_b):
            points = [*points[: a + 1], q_a, q_b, *points[b + 1 :]]
    return np.array(without_needless(points, is_way_free))


def without_needless(points: list[Float], is_way_free: IsWayFree) -> list[Float]:
    """From each point on the farthest that can be reached in a straight line; the ends stay."""
    kept, i = [points[0]], 0
    while i < len(points) - 1:
        j = next((j for j in range(len(points) - 1, i + 1, -1) if is_way_free(points[i], points[j])), i + 1)
        kept.append(points[j])
        i = j
    return kept
