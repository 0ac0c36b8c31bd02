"""When a process counts as failed and when it is started again, by told times."""

import pytest

from shared.runtime.exit_codes import Exit
from shared.runtime.restarts import MAX_STARVED_S, PULSE_LIMIT_S, READY_LIMIT_S, RestartPolicy


@pytest.fixture
def policy():
    policy = RestartPolicy()
    policy.started(0.0)
    return policy


def asleep():
    return False


def failures(policy, now_s, *, is_ready=True, lasts_s=1.0, num=6):
    """Fails again and again, `lasts_s` after each start; returns the delays before the starts, None for giving up."""
    delays = []
    for _ in range(num):
        if is_ready:
            policy.ready(now_s)
        now_s += lasts_s
        restart_s = policy.failed(now_s, Exit.FAILED)
        delays.append(None if restart_s is None else restart_s - now_s)
        if restart_s is None:
            return delays
        now_s = restart_s
        policy.started(now_s)
    return delays


def test_the_first_restart_is_at_once_then_it_backs_off_and_gives_up(policy):
    assert failures(policy, 0.0) == [0.0, 0.5, 1.0, 2.0, 4.0, None]


def test_it_gives_up_on_what_never_gets_ready_however_slowly(policy):
    assert failures(policy, 0.0, is_ready=False, lasts_s=70.0) == [0.0, 0.5, 1.0, 2.0, 4.0, None]


def test_health_forgives(policy):
    assert failures(policy, 0.0, lasts_s=30.0, num=20) == [0.0] * 20


def test_what_has_worked_for_a_while_is_started_again_at_once_but_not_without_end(policy):
    assert failures(policy, 0.0, lasts_s=11.0) == [0.0] * 5 + [None]


def test_restarts_of_more_than_a_minute_ago_do_not_count(policy):
    assert failures(policy, 0.0, lasts_s=12.0, num=20) == [0.0] * 20


@pytest.mark.parametrize("is_ready", [True, False])
def test_a_wrong_configuration_is_given_up_at_once(policy, is_ready):
    if is_ready:
        policy.ready(1.0)
    assert policy.failed(2.0, Exit.USAGE) is None


@pytest.mark.parametrize("exit_code", [0, 1, 3, 130, -9])
def test_any_other_end_is_a_failure(policy, exit_code):
    policy.ready(1.0)
    assert policy.failed(2.0, exit_code) == 2.0


def test_a_pulse_that_stays_away_is_a_frozen_process(policy):
    policy.ready(10.0)
    assert policy.overdue(9.9 + PULSE_LIMIT_S, asleep) is None
    policy.pulsed(11.0)
    assert policy.overdue(10.9 + PULSE_LIMIT_S, asleep) is None
    assert policy.overdue(11.2 + PULSE_LIMIT_S, asleep) == "gave no sign of life for 1.4 s"


def test_a_silent_process_that_is_at_work_is_given_more_time(policy):
    policy.ready(0.0)
    assert policy.overdue(MAX_STARVED_S, lambda: True) is None
    assert policy.overdue(MAX_STARVED_S + 0.1, lambda: True) == "gave no sign of life for 10.1 s"


def test_before_it_is_ready_no_pulse_is_missed_but_the_whole_start_has_a_limit(policy):
    assert policy.overdue(READY_LIMIT_S, asleep) is None
    assert policy.overdue(READY_LIMIT_S + 0.1, asleep) == "was not ready after 60 s"


def test_a_restarted_process_is_given_its_time_again(policy):
    policy.ready(1.0)
    policy.started(100.0)
    assert not policy.is_ready
    assert policy.overdue(101.0 + PULSE_LIMIT_S, asleep) is None
