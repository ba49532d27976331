"""Passes of an image with a time limit: larger ones while there is time, and none that would end too late."""

from lightwell.cache.image_passes import TimeLimit


def test_passes_are_larger_while_one_is_a_part_of_the_time_left():
    limit = TimeLimit(4, 64, 10.0)
    assert limit.block(0.0, False) == 4
    # The first pass may compile kernels: its time says nothing.
    assert not limit.ends(4, 0.0, 2.0) and limit.block(2.0, False) == 4
    assert not limit.ends(4, 2.0, 2.4) and abs(limit.each - 0.1) < 1e-9
    # 3.2 s are less than 0.75 of what is left, 6.4 s are more; 64 samples are the most.
    assert limit.block(2.4, False) == 32 and limit.block(2.4, True) == 4
    assert limit.block(-90.0, False) == 64
    assert limit.block(9.0, False) == 4


def test_a_first_pass_whose_kernels_are_there_is_timed():
    limit = TimeLimit(4, 64, 10.0, recorded=True)
    assert not limit.ends(4, 0.0, 0.4) and limit.block(0.4, False) == 64


def test_halves_of_an_image_have_as_many_samples():
    limit, now, sizes = TimeLimit(4, 64, 10.0, pairs=True), 0.0, []
    while True:
        sizes.append(limit.block(now, False))
        start, now = now, now + 0.05 * sizes[-1]
        if limit.ends(sizes[-1], start, now):
            break
    assert max(sizes) > 4 and now <= 10.0
    assert sizes[::2][: len(sizes) // 2] == sizes[1::2]


def test_an_image_ends_where_another_small_pass_would_be_late():
    limit = TimeLimit(4, 64, 1.0)
    assert not limit.ends(4, 0.0, 0.1) and not limit.ends(4, 0.1, 0.5)
    assert limit.ends(4, 0.5, 0.9)
