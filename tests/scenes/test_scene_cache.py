"""What is worked out from a scene stays with that scene, and is bounded."""

import threading

from lightwell.scenes.scene_cache import Derived, SceneCache

SQUARES = Derived[int]("test.squares", most=2)


def test_made_once_and_bounded():
    cache, made = SceneCache(), []

    def square(k):
        return cache.get(SQUARES, lambda: made.append(k) or k * k, k)

    assert [square(k) for k in (1, 2, 1, 3, 1, 2)] == [1, 4, 1, 9, 1, 4]
    assert made == [1, 2, 3, 2], "the least recently used result goes first"


def test_scenes_share_nothing():
    a, b = SceneCache(), SceneCache()
    assert a.get(SQUARES, lambda: 1) == 1 and b.get(SQUARES, lambda: 2) == 2 and a.get(SQUARES, lambda: 3) == 1


def test_threads_make_a_result_once():
    cache, made, together = SceneCache(), [], threading.Barrier(4)

    def ask():
        together.wait()
        cache.get(SQUARES, lambda: made.append(1) or 1)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == [1]
