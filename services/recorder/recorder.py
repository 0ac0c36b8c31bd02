"""The recorder's facade: records whatever it is given, stamped with simulated time, and says what became of it."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import replace

from services.recorder.bus_counts import BusCounts
from services.recorder.disk import RecordingError, check_room, free_bytes
from services.recorder.news import News
from services.recorder.records import Record, to_record
from services.recorder.rotation import is_repeated_in_each_file, num_files_in
from services.recorder.run import Run
from services.recorder.selection import Selection, problem_with
from services.recorder.state import RecorderState
from shared.errors import ConfigError, InputFileError, MessageError, RefusedError
from shared.messaging.channels import (
    CHANNELS,
    CLOCK,
    HEALTH,
    PREFIX,
    RECORDER_CONTROL,
    Channel,
    channel_of_key,
)
from shared.messaging.messages import (
    Event,
    Health,
    Measurement,
    Message,
    RecorderAction,
    RecorderControl,
    RecorderStatus,
    Severity,
)
from shared.messaging.values import MAX_SERVICES
from shared.runtime.config import RecorderConfig
from shared.runtime.run_folder import make_run_folder, new_run_name

_MAX_EARLY = 1000
_MAX_STOP_S = 10.0
_MAX_END_S = 2.0
"""At the end of the process, which a supervisor does not wait for without end."""
_RUN_NAME = re.compile(r"[A-Za-z0-9_:-][A-Za-z0-9_.:-]*")


class Recorder:
    """Writes runs below `config.directory`. What has no time of its own is logged at the newest time seen: a command,
    and what a service says that has seen no time yet. Before any time is known such messages wait, up to a thousand of
    them, or a recording of a real sensor, whose time is that of day, would begin in 1970.

    metadata: text kept at the head of each file. channels: the table, with those of further sensors. robot: namespace.

    Raises:
        ConfigError: `config.channels` has a pattern that no key matches.
    """

    def __init__(
        self,
        config: RecorderConfig,
        metadata: Mapping[str, str],
        channels: Iterable[Channel] = CHANNELS,
        robot: str = "",
    ) -> None:
        self._config, self._metadata, self._robot = config, metadata, robot
        if (problem := problem_with(config.channels, table := tuple(channels))) is not None:
            raise ConfigError([f"recorder.{problem}"])
        chosen = Selection(config.channels)
        self.channels = tuple(channel for channel in table if channel in chosen or channel in (HEALTH, CLOCK))
        """What it wants to be given, and may record: the configured ones, heartbeats (what was sent), the time."""
        self._keys = {channel.key for channel in self.channels}
        self._run: Run | None = None
        self._bus = BusCounts()
        self._kept: dict[str, Record] = {}
        self._stamp_ns: int | None = None
        self._waiting: deque[tuple[Channel, Message, int]] = deque()
        self._num_commands: Counter[str] = Counter()
        self._num_statuses = 0
        self._services: set[str] = set()
        self._news = News()
        self._restored: RecorderState | None = None
        self._wanted: tuple[str, tuple[str, ...]] = "", ()
        self.has_lost = False

    # ---- what a node calls

    def start(self) -> list[Message]:
        """Begins the configured run, if the configuration says so.

        Raises:
            RecordingError: the disk refuses.
            InputFileError: the folder cannot be made.
        """
        restored, self._restored = self._restored, None
        if restored is not None and restored.run:
            self._begin(restored.run, restored.channels, is_going_on=True)
        elif restored is None and self._config.starts:
            self._begin(self._config.run or new_run_name(self._config, self._robot), self._config.channels)
        return [self._status()]

    def snapshot(self) -> RecorderState:
        """What `restore` needs."""
        name, patterns = self._wanted
        return RecorderState(
            configured=self._config.run,
            run=name,
            channels=patterns,
            num_statuses=self._num_statuses,
            has_lost=self.has_lost or bool(name),
        )

    def restore(self, state: RecorderState) -> list[Message]:
        """The start that follows goes on with the run of a recorder that was killed, in its next file.

        Raises:
            ValueError: it was told to record another run.
        """
        if state.configured != self._config.run:
            raise ValueError(f"recorder.run was '{state.configured}', is '{self._config.run}'")
        self._restored = state
        self._num_statuses, self.has_lost = state.num_statuses, state.has_lost
        if not state.run:
            return []
        text = f"restored: goes on with run {state.run} in a new file; what was sent meanwhile is not in it"
        return [Event(stamp_ns=0, seq=0, frame="", source="recorder", severity=Severity.WARNING, text=text)]

    def add(self, channel: Channel, message: Message) -> list[Message]:
        """Records one message.

        Raises:
            MessageError: it has a number that its ROS type cannot hold, or it is of one service too many.
        """
        concrete = channel.of(message.service) if isinstance(message, Health) else channel
        if isinstance(message, Health):
            self._note_service(message.service)
            self._bus.heard(message)
        num_missed = self._bus.received(concrete.key, message)
        stamp_ns = _time_of(message)
        self._stamp_ns = self._stamp_ns if stamp_ns is None else stamp_ns
        self._waiting.append((concrete, message, num_missed))
        if self._stamp_ns is not None or len(self._waiting) > _MAX_EARLY:
            self._put_waiting()
        return []

    def control(self, control: RecorderControl) -> list[Message]:
        """Starts or stops.

        Raises:
            RefusedError: it is so already, the run or its channels cannot be had, or the disk refuses.
        """
        self.add(RECORDER_CONTROL, control)
        if control.action is RecorderAction.STOP:
            if self._run is None or not self._run.is_recording:
                reason = self._run.text if self._run else ""
                raise RefusedError(f"nothing is being recorded: {reason}" if reason else "nothing is being recorded")
            self._end(_MAX_STOP_S)
            self._wanted = "", ()
            return self.tick()
        if self._run is not None and self._run.is_recording:
            raise RefusedError(f"{self._run.path} is being recorded: stop it first")
        if (problem := problem_with(control.channels, self.channels)) is not None:
            raise RefusedError(problem)
        if control.run and not _RUN_NAME.fullmatch(control.run):
            raise RefusedError(f"run is '{control.run[:40]}', must be of letters, digits and _ . : -")
        try:
            self._begin(
                control.run or new_run_name(self._config, self._robot), control.channels or self._config.channels
            )
        except (RecordingError, InputFileError) as error:
            raise RefusedError(str(error)) from error
        return [self._status()]

    def tick(self) -> list[Message]:
        """Once a second: the status, and an event when something was lost or the disk refuses."""
        status = self._status()
        return [*self._news.of(status), status]

    def close(self) -> list[Message]:
        """Completes the recording with index and counts. Idempotent."""
        if self._run is None:
            return []
        self._end(_MAX_END_S)
        return self.tick()

    def num_lost_to_disk(self) -> dict[str, int]:
        """By key expression, for the heartbeat."""
        if self._run is None:
            return {}
        return {PREFIX + record.key: record.num_lost_to_disk for record in self._run.records({})}

    def _note_service(self, name: str) -> None:
        """Each service is a topic of its own in the file, which holds so many."""
        if name not in self._services and len(self._services) >= MAX_SERVICES:
            raise MessageError(f"{name[:40]!r} is one service too many: {MAX_SERVICES} are recorded")
        self._services.add(name)

    # ---- the run

    def _begin(self, name: str, patterns: tuple[str, ...], *, is_going_on: bool = False) -> None:
        if self._run is not None:
            self._end(_MAX_STOP_S)
        folder = make_run_folder(self._config, name)
        check_room(folder, self._config.min_free_mib)
        self._bus.settle()
        first_file = num_files_in(folder) if is_going_on else 0
        self._run = Run(
            self._config, folder, self.channels, Selection(patterns), self._metadata, self._kept, first_file
        )
        self._news = News()
        self._wanted = name, patterns

    def _end(self, max_wait_s: float) -> None:
        run = self._run
        if run is None or not run.is_open:
            return
        self._put_waiting()
        outstanding = self._outstanding()
        channels = {key: channel_of_key(PREFIX + key) for key in outstanding}
        run.close(
            {channel: outstanding[key] for key, channel in channels.items() if channel and channel in run.selection},
            max_wait_s,
        )
        self.has_lost |= bool(run.text) or any(
            record.num_lost_on_bus or record.num_lost_to_disk for record in run.records({})
        )

    def _put_waiting(self) -> None:
        while self._waiting:  # one that is refused leaves the others
            self._put(*self._waiting.popleft())

    def _put(self, channel: Channel, message: Message, num_missed: int) -> None:
        is_repeated, run = is_repeated_in_each_file(channel), self._run
        is_taken = run is not None and run.is_open and channel in run.selection
        if not (is_repeated or is_taken):
            return
        self._num_commands[channel.key] += channel.is_command
        stamp_ns = _time_of(message)
        if stamp_ns is None:
            stamp_ns = self._stamp_ns or 0
            message = replace(message, stamp_ns=stamp_ns) if isinstance(message, Measurement) else message
        number = self._num_commands[channel.key]
        record = to_record(channel, message, stamp_ns, number=number, num_missed=num_missed)
        if is_repeated:
            self._kept[channel.key] = record
        if run is not None and is_taken:
            run.put(record)

    def _outstanding(self) -> Counter[str]:
        """By key: what was sent, as far as is known, and has not come. Of what it is not given, nothing is lost."""
        own = HEALTH.key.removesuffix("*")
        outstanding = self._bus.outstanding()
        return Counter({key: num for key, num in outstanding.items() if key in self._keys or key.startswith(own)})

    # ---- what it says

    def _status(self) -> RecorderStatus:
        run, seq = self._run, self._num_statuses
        self._num_statuses += 1
        return RecorderStatus(
            stamp_ns=self._stamp_ns or 0,
            seq=seq,
            frame="",
            is_recording=run is not None and run.is_recording,
            path=str(run.path) if run else "",
            num_files=run.num_files if run else 0,
            num_bytes=run.num_bytes if run else 0,
            free_bytes=free_bytes(run.path.parent if run else self._config.directory),
            text=run.text if run else "",
            channels=run.records(self._outstanding()) if run else (),
        )


def _time_of(message: Message) -> int | None:
    """None: a command, or what a service says that has seen no time yet."""
    if not isinstance(message, Measurement):
        return None
    return None if isinstance(message, Health | Event | RecorderStatus) and message.stamp_ns == 0 else message.stamp_ns
