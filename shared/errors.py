"""The errors that cross module borders. Each says what is wrong, where, and what is allowed."""


class HyrecroError(Exception):
    """Base of every error this project raises on purpose."""


class MessageError(HyrecroError):
    """A message whose fields break its own declaration (dtype, shape, range, finiteness)."""


class CodecError(HyrecroError):
    """Bytes that are not the message they should be: truncated, oversized, mistyped, wrong version."""


class RefusedError(HyrecroError):
    """A well-formed command that cannot be carried out; the text is the reason given to the sender."""


class ConfigError(HyrecroError):
    """A configuration with one or more problems, all listed in `problems`, one line each."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


class InputFileError(HyrecroError):
    """A file given by the user that cannot be used: the text names file, place and rule."""


class SnapshotError(HyrecroError):
    """A snapshot that cannot be written, or not used: the text names the file and why."""


class PlaybackError(HyrecroError):
    """A trajectory that cannot go on: a refused command, or a target that is not reached in time."""


class StoppedError(HyrecroError):
    """Someone stopped the robot before all was done: what is done is done."""


class PortError(HyrecroError):
    """A port that cannot be listened on."""


class BusError(HyrecroError):
    """The router cannot be reached or the session was lost."""


class CloudFileError(HyrecroError):
    """A point cloud file whose content cannot be used: the text names the file and what is wrong in it."""


class TrajectoryFileError(HyrecroError):
    """A trajectory file whose content cannot be used: the text names file, line and rule."""
