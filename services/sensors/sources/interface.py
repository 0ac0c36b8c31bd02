"""What the readers of recordings give and the playback takes."""

from __future__ import annotations

from collections.abc import Generator

from shared.messaging.messages import Measurement

Recording = Generator[Measurement, None, str]
"""The messages of a recording in its order, each read when it is asked for; `seq` counts every type from 0.

Returns how the recording ended if not as it should, else an empty text. Closing it lets go of the file. It raises
InputFileError, at its first message or later, where the recording cannot be used.
"""
