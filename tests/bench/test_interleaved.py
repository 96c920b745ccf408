from __future__ import annotations

import numpy as np
import pytest
from bench_kit import PEERS, absent, estimator_of, silent, some_views

from farpoint.bench.estimators import Motion
from farpoint.bench.interleaved import one_thread, run_interleaved

VIEWS = some_views(3)


def test_estimators_take_turns_on_the_same_views_after_one_that_does_not_count():
    calls = []

    def recorder(name: str):
        def answer(views):
            calls.append((name, VIEWS.index(views)))
            return None

        return estimator_of(name, answer)

    run_interleaved((recorder("a"), recorder("b")), VIEWS, seed=0)
    in_turn = [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]
    assert calls == [("a", 0), ("b", 0), *in_turn]


def test_short_calls_are_repeated_and_long_ones_not(monkeypatch: pytest.MonkeyPatch):
    clock = iter(np.cumsum([0.0, 0.003, 1.0, 0.001, 1.0, 0.002, 1.0, 0.05]))
    monkeypatch.setattr("farpoint.bench.interleaved.time.perf_counter", lambda: next(clock))
    calls = []
    estimator = estimator_of("any", calls.append)
    (run,) = run_interleaved((estimator,), VIEWS[:2], seed=0, repeats=3)
    np.testing.assert_allclose(run.seconds, [0.001, 0.05])
    np.testing.assert_allclose(run.first_seconds, [0.003, 0.05])
    assert len(calls) == 1 + 3 + 1


def test_what_is_not_answered_is_nan():
    answers = {0: None, 1: Motion(np.eye(3), None), 2: Motion(np.eye(3), np.array([0, 0, 1.0]))}
    estimator = estimator_of("any", lambda views: answers[VIEWS.index(views)])
    (run,) = run_interleaved((estimator,), VIEWS, seed=0)
    assert np.isnan(run.rotations[:, 0, 0]).tolist() == [True, False, False]
    assert np.isnan(run.directions[:, 0]).tolist() == [True, True, False]


def test_progress_counts_the_views():
    told = []
    run_interleaved(
        (estimator_of("any", silent),), VIEWS, seed=0, progress=lambda *a: told.append(a)
    )
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_opencv_gets_its_threads_back_even_after_a_fault():
    cv2 = pytest.importorskip("cv2")
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        with pytest.raises(RuntimeError, match="1 thread"), one_thread():
            raise RuntimeError(f"{cv2.getNumThreads()} thread")
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_one_thread_without_opencv(monkeypatch: pytest.MonkeyPatch):
    absent(monkeypatch, *PEERS)
    with one_thread():
        pass
