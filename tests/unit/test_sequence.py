from shared.messaging.sequence import SequenceCounter


def count(*numbers):
    counter = SequenceCounter()
    return [counter.add(number) for number in numbers], counter


def test_nothing_missed_in_a_row():
    assert count(5, 6, 7)[0] == [0, 0, 0]


def test_gaps_are_counted():
    missed, counter = count(0, 1, 4, 5, 9)
    assert missed == [0, 0, 2, 0, 3]
    assert (counter.num_received, counter.num_missed) == (5, 5)


def test_a_publisher_that_starts_again_counts_from_zero():
    assert count(7, 8, 0, 1)[0] == [0, 0, 0, 0]
    assert count(7, 8, 2, 3)[0] == [0, 0, 2, 0]


def test_what_was_missed_and_comes_after_all_is_missed_no_longer():
    missed, counter = count(5, 8, 6, 9, 7, 10)
    assert missed == [0, 2, -1, 0, -1, 0]
    assert (counter.num_received, counter.num_missed, counter.last_seq) == (6, 0, 10)


def test_a_number_that_came_already_is_a_new_start():
    assert count(5, 8, 6, 6, 7)[0] == [0, 2, -1, 6, 0]


def test_only_the_last_missed_numbers_are_remembered():
    assert count(0, 2**62, 2**62 - 1, 1)[0] == [0, 2**62 - 1, -1, 1]
