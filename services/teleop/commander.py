"""Who commands: one browser at a time, as long as its page answers."""

from __future__ import annotations


class Commander:
    """Knows the browsers and which of them commands; the first to come does while nobody else."""

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._heard_s: dict[int, float] = {}
        self.client: int | None = None

    @property
    def num_clients(self) -> int:
        """How many browsers have the page open."""
        return len(self._heard_s)

    def join(self, client: int, now_s: float) -> None:
        """Notes a browser."""
        self._heard_s[client] = now_s
        self.client = client if self.client is None else self.client

    def leave(self, client: int) -> bool:
        """Forgets a browser; returns whether it was the one that commands. The others must ask for control."""
        self._heard_s.pop(client, None)
        was_commander = client == self.client
        self.client = None if was_commander else self.client
        return was_commander

    def hear(self, client: int, now_s: float) -> None:
        """Notes that a browser has answered."""
        if client in self._heard_s:
            self._heard_s[client] = now_s

    def take(self, client: int) -> None:
        """Gives this browser control."""
        self.client = client

    def is_heard(self, now_s: float) -> bool:
        """Whether there is somebody who commands and answers."""
        return self.client is not None and now_s - self._heard_s.get(self.client, -1e9) <= self._silence_s
