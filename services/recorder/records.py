"""Messages as they stand in a file: CDR bytes with their times and number."""

from __future__ import annotations

from dataclasses import dataclass

from services.recorder.ros.messages import to_cdr
from shared.messaging.channels import Channel
from shared.messaging.messages import Measurement, Message

_UINT32_RANGE = 2**32


@dataclass(frozen=True, slots=True)
class Record:
    """One message, ready to be written.

    stamp_ns: when it was measured. log_ns: its place in the file. num_missed: how many of its publisher's were lost on
    the bus just before it. is_repeated: it was received before this file began, and stands at its head again.
    """

    channel: Channel
    stamp_ns: int
    log_ns: int
    sequence: int
    data: memoryview
    num_missed: int = 0
    is_repeated: bool = False


def to_record(channel: Channel, message: Message, stamp_ns: int, *, number: int, num_missed: int = 0) -> Record:
    """A message at `stamp_ns`. number: stands for `seq` where the message has none.

    Raises:
        MessageError: the message has no ROS form.
    """
    _, data = to_cdr(message, stamp_ns)
    sequence = (message.seq if isinstance(message, Measurement) else number) % _UINT32_RANGE
    return Record(channel, stamp_ns, stamp_ns, sequence, data, num_missed)
