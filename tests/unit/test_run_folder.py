from shared.runtime.config import RecorderConfig
from shared.runtime.run_folder import new_run_name, run_name


def test_two_robots_that_begin_in_the_same_second_do_not_share_a_folder(tmp_path):
    config = RecorderConfig(directory=tmp_path)
    names = {run_name(config, robot).partition("Z")[2] for robot in ("", "robot_a", "fleet/robot_b")}
    assert names == {"", "_robot_a", "_fleet_robot_b"}


def test_a_name_that_was_given_is_the_name(tmp_path):
    assert run_name(RecorderConfig(directory=tmp_path, run="climb"), "robot_a") == "climb"


def test_a_folder_that_is_there_is_not_taken_again(tmp_path):
    config = RecorderConfig(directory=tmp_path)
    first = new_run_name(config, "robot_a")
    (tmp_path / first).mkdir()
    second = new_run_name(config, "robot_a")
    assert second != first
    assert "_robot_a" in second
