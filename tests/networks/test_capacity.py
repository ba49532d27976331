"""Room for samples: never exceeded, always enough, and without effect where it is ample."""

import numpy as np
import pytest

from lightwell.networks.capacity import assign_within


@pytest.mark.parametrize("count, experts, capacity", [(100, 10, 10), (1000, 7, 150), (5, 5, 1), (64, 3, 64)])
def test_the_cap_is_kept_and_all_are_placed(count, experts, capacity):
    preference = np.random.default_rng(0).dirichlet(np.linspace(0.1, 3, experts), count)
    expert = assign_within(preference, capacity)
    assert expert.min() >= 0 and np.bincount(expert, minlength=experts).max() <= capacity


def test_ample_room_is_the_plain_argmax():
    preference = np.random.default_rng(1).random((200, 6))
    assert (assign_within(preference, 200) == preference.argmax(axis=1)).all()


def test_the_keenest_get_in():
    preference = np.array([[0.9, 0.1], [0.8, 0.2], [0.7, 0.3]])
    assert assign_within(preference, 2).tolist() == [0, 0, 1]


def test_too_little_room_is_refused():
    with pytest.raises(ValueError, match="cannot take 10 samples"):
        assign_within(np.ones((10, 3)), 3)
