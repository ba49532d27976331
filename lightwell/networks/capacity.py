"""Assignment of samples to experts of limited capacity."""

from __future__ import annotations

import numpy as np


def assign_within(preference: np.ndarray, capacity: int) -> np.ndarray:
    """Assign each sample to its most preferred expert that has capacity left; the highest preferences are served first.

    Samples whose expert is full ask their next one, which has its remaining capacity: greedy, not optimal, at most M
    rounds. Ties go to the lower row.

    Args:
        preference: [N, M] preference of each sample for each expert.
        capacity: Largest number of samples of an expert.

    Returns:
        [N] int, the expert of each sample.

    Raises:
        ValueError: M experts of this capacity cannot take N samples.
    """
    count, experts = preference.shape
    if capacity * experts < count:
        raise ValueError(f"assign: {experts} experts with room for {capacity} cannot take {count} samples; raise it")
    left = np.array(preference, np.float64)
    room = np.full(experts, capacity)
    expert = np.full(count, -1)
    waiting = np.arange(count)
    while len(waiting):
        left[:, room == 0] = -np.inf
        wanted = left[waiting].argmax(axis=1)
        # Per expert, by descending preference: place of each sample in its expert's queue.
        order = np.lexsort((waiting, -left[waiting, wanted], wanted))
        queue = np.bincount(wanted, minlength=experts)
        first = np.concatenate([[0], np.cumsum(queue)[:-1]])
        place = np.empty(len(waiting), np.int64)
        place[order] = np.arange(len(waiting)) - first[wanted[order]]
        accepted = place < room[wanted]
        expert[waiting[accepted]] = wanted[accepted]
        room -= np.minimum(queue, room)
        waiting = waiting[~accepted]
    return expert
