"""What people should read of a recording while it goes on."""

from __future__ import annotations

from shared.messaging.messages import Event, RecorderStatus, Severity


class News:
    """Tells of a disk that refuses, once, and of losses when they begin: not again before a second without."""

    def __init__(self) -> None:
        self._told_failure = ""
        self._num_lost = 0
        self._is_losing = False

    def of(self, status: RecorderStatus) -> list[Event]:
        """What is new since the status before."""
        lost = [record for record in status.channels if record.num_lost_on_bus or record.num_lost_to_disk]
        num_lost = sum(record.num_lost_on_bus + record.num_lost_to_disk for record in lost)
        is_losing = num_lost > self._num_lost
        events = []
        if status.text != self._told_failure and status.text:
            events.append(_event(status, Severity.ERROR, f"the recording has stopped: {status.text}"))
        elif is_losing and not (self._is_losing or status.text):
            keys = ", ".join(record.key for record in lost)
            events.append(_event(status, Severity.WARNING, f"{num_lost} messages are not in the recording: {keys}"))
        self._told_failure, self._num_lost, self._is_losing = status.text, num_lost, is_losing
        return events


def _event(status: RecorderStatus, severity: Severity, text: str) -> Event:
    return Event(stamp_ns=status.stamp_ns, seq=0, frame="", source="recorder", severity=severity, text=text)
