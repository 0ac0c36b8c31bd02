import numpy as np

from services.mapper.planes.voxel_table import empty_table, put, put_about, put_around, slot_at, with_room


def listed(table, x, y, z):
    entries = table.lists[slot_at(table, x, y, z)]
    return {int(e) >> 1: bool(e & 1) for e in entries if e >= 0}


def test_a_patch_is_found_where_it_was_put_and_nowhere_else():
    table = empty_table(0.1, 6)
    put(table, 0.0, 0.0, 0.0, 7, False)
    put(table, 0.04, -0.04, -0.03, 3, True)
    assert listed(table, -0.03, -0.03, -0.03) == {7: False, 3: True}
    assert listed(table, -0.07, -0.03, -0.03) == {}
    put(table, 0.0, 0.0, 0.0, 7, True)
    put(table, 0.0, 0.0, 0.0, 7, False)
    assert listed(table, -0.03, -0.03, -0.03) == {7: True, 3: True}
    assert table.num_used[0] == 1


def test_places_far_away_do_not_meet():
    table = empty_table(0.1, 2)
    places = [(1e4, -1e4, 5e3), (-1e4, 1e4, 5e3), (1e4, -1e4, 5e3 + 0.1), (0.0, 0.0, 0.0)]
    for patch, place in enumerate(places):
        put(table, *place, patch, True)
    for patch, place in enumerate(places):
        assert listed(table, *place) == {patch: True}


def test_a_grown_table_knows_what_the_smaller_one_knew():
    table, rng = empty_table(0.1, 4, num_slots=64), np.random.default_rng(0)
    places = rng.uniform(-3, 3, size=(500, 3))
    for patch, place in enumerate(places):
        table = with_room(table, 1, 1 << 12)
        put(table, *place, patch, True)
    assert len(table.keys) == 1024
    assert all(patch in listed(table, *place) for patch, place in enumerate(places))


def test_a_full_table_takes_up_no_more_and_a_full_list_neither():
    table = empty_table(0.1, 2, num_slots=64)
    for i in range(500):
        table = with_room(table, 1, 128)
        put(table, float(i), 0.0, 0.0, i, True)
    assert len(table.keys) == 128
    assert table.num_used[0] == 96
    for patch in (1000, 1001, 1002):
        put(table, 0.0, 0.0, 0.0, patch, True)
    assert listed(table, 0.0, 0.0, 0.0) == {0: True, 1000: True}


def test_a_patch_is_known_in_the_voxels_around():
    near, around = empty_table(0.1, 2), empty_table(0.1, 2)
    put_about(near, -0.03, 0.0, 0.03, 1)
    put_around(around, -0.03, 0.0, 0.03, 1)
    assert (near.num_used[0], around.num_used[0]) == (8, 27)
    assert listed(near, -0.06, 0.0, 0.06) == {1: False}
    assert listed(near, 0.06, 0.0, 0.0) == {}
    assert listed(around, 0.06, -0.06, 0.0) == {1: False}
    assert listed(around, 0.0, 0.0, 0.0) == {1: True}
