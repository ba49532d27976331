"""Assigning samples to experts that have limited room."""

from __future__ import annotations

import numpy as np


def assign_within(preference: np.ndarray, capacity: int) -> np.ndarray:
    """Each sample's most preferred expert that has room; those that prefer it most get in. [N, M] → [N] int.

    Every sample is placed; no expert gets more than ``capacity`` samples. Samples that find their expert full ask the
    next one, with its room that is left: greedy, not optimal, and at most M rounds. Ties go to the lower row.
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
        # Per expert, the keenest first: place of each sample in its expert's queue.
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
