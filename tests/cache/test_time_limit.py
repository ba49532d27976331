"""Passes of an image with a time limit: larger ones while there is time, and none that would end too late."""

from lightwell.cache.image_passes import TimeLimit


def test_passes_are_larger_while_one_is_a_small_part_of_the_time_left():
    limit = TimeLimit(4, 10.0)
    assert limit.block(0.0, False) == 4
    # The first pass of a size may compile kernels: its time says nothing.
    assert not limit.ends(4, 0.0, 2.0) and limit.block(2.0, False) == 4
    assert not limit.ends(4, 2.0, 2.4) and abs(limit.longest - 0.1) < 1e-9
    assert limit.block(2.4, False) == 16 and limit.block(2.4, True) == 4
    # 1.6 s are more than 0.3 of what is left then.
    assert limit.block(5.0, False) == 4


def test_an_image_ends_where_another_small_pass_would_be_late():
    limit = TimeLimit(4, 1.0)
    assert not limit.ends(4, 0.0, 0.1) and not limit.ends(4, 0.1, 0.5)
    assert limit.ends(4, 0.5, 0.9)
