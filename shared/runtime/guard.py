"""The first process of a container: keeps one service running, as the launcher does where there are no containers.

`python -m shared.runtime.guard /tmp/ready services.sensors --sensor lidar`

The file is there while the service does its work, and is touched at each look: an old one tells of a frozen guard.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path

from shared.runtime.exit_codes import Exit
from shared.runtime.logs import configure_logs
from shared.runtime.stop_signal import StopSignal
from shared.runtime.supervision import POLL_S, PatientClock, Supervised


def main() -> None:
    """Until SIGTERM, or until the service is given up; ends with the service's exit code."""
    if len(sys.argv) < 3 or any(argument.startswith("-") for argument in sys.argv[1:3]):
        print("usage: python -m shared.runtime.guard READY_FILE MODULE [ARGUMENT ...]", file=sys.stderr)
        sys.exit(Exit.USAGE)
    ready, command = Path(sys.argv[1]), sys.argv[2:]
    configure_logs()
    stop, clock = StopSignal(), PatientClock()
    child = Supervised(" ".join(command), ["-m", *command], clock.now_s())
    while not stop.is_set() and child.failure is None:
        child.step(clock.now_s())
        _show(ready, is_ready=child.is_ready)
        _reap_orphans(child.pid)
        time.sleep(POLL_S)
    _show(ready, is_ready=False)
    child.stop()
    if child.failure is not None:
        print(f"given up: {child.failure}", file=sys.stderr)
    sys.exit(_exit_code(child))


def _show(ready: Path, *, is_ready: bool) -> None:
    if is_ready:
        ready.touch()
    else:
        ready.unlink(missing_ok=True)


def _exit_code(child: Supervised) -> int:
    """Never fine when it was given up, or the container would not be started again."""
    code = child.exit_code or Exit.FINE
    if code < 0:
        return 128 - code
    return code or (Exit.FAILED if child.failure is not None else Exit.FINE)


def _reap_orphans(own_pid: int | None) -> None:
    """Whose parent has ended falls to the first process of a container."""
    flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitid(os.P_ALL, 0, flags)) is not None and ended.si_pid != own_pid:
            os.waitpid(ended.si_pid, 0)


if __name__ == "__main__":
    main()
