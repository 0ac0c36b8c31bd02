"""What `hyrecro robot play` says while it hears nothing of the robot."""

from cli.playback import Silence


def test_silence_and_its_end_are_said_once_each():
    now_s, said = [0.0], []
    silence = Silence(lambda: round(now_s[0] * 1e9), said.append)
    for now_s[0] in (0.0, 2.9, 3.1, 9.0):
        silence.look()
    assert said == ["no joint state for 3 s (cut off, or paused): waits"]
    for now_s[0] in (10.0, 10.1, 12.0):
        silence.hear()
        silence.look()
    assert said[1:] == ["joint states come again: goes on"]
    now_s[0] = 15.1
    silence.look()
    assert len(said) == 3
