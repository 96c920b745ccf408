"""Five-ray hypotheses of the search: solver, score, sign and number of samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, moved, packed, rays_only, two_views

from farpoint._kernels import ambiguous_motions, five_rays, search
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import RELATED_CONSENSUS, SHORT_TAIL, START_FAILURE_RATE
from farpoint._kernels.hypothesis_comparison import default_noise, initial_noise
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint.geometry import so3, sphere

quick = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 2**32)


def solve_five(
    view: View, sample: list[int], R: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    R, t = R.copy(), t.copy()
    return (R, t) if five_rays.solve_five(view.pairs, np.array(sample), R, t) else None


def score(
    view: View, R: np.ndarray, t: np.ndarray, limit: float, best: float = math.inf
) -> tuple[float, np.ndarray]:
    t = t.copy()
    return five_rays.score_pose(view.pairs, packed(np.ones(view.size)), R, t, limit, best), t


def search_direction(view: View, tolerance: float, seed: int) -> np.ndarray:
    t, state = np.full(3, np.nan), np.array([seed], np.uint64)
    everyone = packed(np.ones(view.size))
    search.search_direction(
        view.pairs, everyone, np.arange(view.size), tolerance, 100, state, view.R, t
    )
    return t


def iterations_needed(
    outliers: float,
    confidence: float,
    least: int = 0,
    most: int = 10**6,
    *,
    known: float = 1.0,
    flow_rad: float = 0.0,
    has_competing_mode: bool = True,
) -> int:
    budget = five_rays.SearchBudget(3.0, confidence, least, most)
    return five_rays.iterations_needed(outliers, known, flow_rad, has_competing_mode, budget)


def constraints(view: View, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.sum(view.rays1 * np.cross(t, view.rays0 @ R.T), axis=1)


def residuals2(view: View, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Squared constraints over their variances."""
    m, b = view.rays0 @ R.T, view.rays1
    q0 = np.einsum("nik,ni->nk", R @ view.noise0, np.cross(b, t))
    q1 = np.einsum("nik,ni->nk", view.noise1, np.cross(t, m))
    return constraints(view, R, t) ** 2 / (np.sum(q0**2, axis=1) + np.sum(q1**2, axis=1))


@quick
@given(seed=seeds)
def test_a_solution_satisfies_all_five_constraints(seed):
    view = two_views(seed, 5, error_rad=1e-3)
    rng = np.random.default_rng(seed)
    solution = solve_five(view, [0, 1, 2, 3, 4], *moved(view.R, view.t, rng.normal(0, 0.1, 5)))
    if solution is not None:  # From an inaccurate start Newton may not converge, and returns False.
        R, t = solution
        # Within the noise of a ray, which the refinement removes.
        np.testing.assert_allclose(constraints(view, R, t), 0.0, rtol=0.0, atol=1e-4)
        np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-12)
        assert np.linalg.norm(t) == pytest.approx(1.0, abs=1e-12)


def test_the_true_pose_is_found_from_nearby():
    found = 0
    for seed in range(100):
        view = two_views(seed, 8, baseline_m=1.0)
        step = np.random.default_rng(seed).normal(0.0, 0.02, 5)
        solution = solve_five(view, [7, 0, 5, 2, 3], *moved(view.R, view.t, step))
        if solution is None:
            continue
        R, t = solution
        found += so3.angle_between(R, view.R) < 1e-3 and sphere.angle_between(t, view.t) < 2e-3
    # Some samples have a second solution as near as the true one.
    assert found >= 80


def test_the_true_pose_itself_is_a_solution_and_stays():
    for seed in range(20):
        view = two_views(seed, 5)
        solution = solve_five(view, [0, 1, 2, 3, 4], view.R, view.t)
        assert solution is not None
        np.testing.assert_allclose(solution[0], view.R, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(solution[1], view.t, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("sample", [[0, 0, 0, 0, 0], [0, 1, 1, 2, 3]], ids=["one", "a repeat"])
def test_repeated_matches_determine_no_pose(sample):
    view = two_views(0, 5, error_rad=1e-2)
    assert solve_five(view, sample, view.R, view.t) is None


@quick
@given(seed=seeds, limit=st.sampled_from([0.5, 9.0]))
def test_the_score_is_the_sum_of_truncated_squares_at_the_better_sign(seed, limit):
    # Parallax far above the noise: all flow towards the direction, none the other way.
    view = two_views(seed, 12, error_rad=1e-3, depth_m=(2.0, 3.0))
    expected = np.minimum(residuals2(view, view.R, view.t), limit).sum()
    forward, kept = score(view, view.R, view.t, limit)
    backward, flipped = score(view, view.R, -view.t, limit)
    np.testing.assert_array_equal(kept, view.t)
    np.testing.assert_array_equal(flipped, view.t)
    # A point near the epipole has no flow and may flow either way.
    assert forward == pytest.approx(expected, abs=1.01 * limit)
    assert backward == pytest.approx(forward, rel=1e-12)


def test_a_point_behind_the_camera_counts_as_an_outlier():
    view = two_views(1, 12)
    swapped = view.rays1.copy()
    rotated = view.rays0 @ view.R.T
    # Mirrored on the rotation's prediction, the match flows away from the direction.
    swapped[4] = sphere.normalize(2.0 * (rotated[4] @ swapped[4]) * rotated[4] - swapped[4])
    assert abs(constraints(view._replace(rays1=swapped), view.R, view.t)[4]) < 1e-12
    clean, _ = score(view, view.R, view.t, 9.0)
    behind, _ = score(view._replace(rays1=swapped), view.R, view.t, 9.0)
    assert clean == pytest.approx(0.0, abs=1e-9)
    assert behind == pytest.approx(9.0)


def test_a_far_point_does_not_vote_on_the_sign():
    view = two_views(1, 12, baseline_m=1e-6, error_rad=1e-5)
    expected = np.minimum(residuals2(view, view.R, view.t), 9.0).sum()
    for sign in (1.0, -1.0):
        cost, t = score(view, view.R, sign * view.t, 9.0)
        assert cost == pytest.approx(expected)
        np.testing.assert_array_equal(t, sign * view.t)


@quick
@given(seed=seeds)
def test_scoring_stops_early_only_for_losers(seed):
    view = two_views(seed, 12, error_rad=1e-3)
    full, _ = score(view, view.R, view.t, 9.0)
    assert score(view, view.R, view.t, 9.0, best=full * 1.01 + 1e-9)[0] == full
    assert score(view, view.R, view.t, 9.0, best=0.9 * full)[0] >= 0.9 * full


@pytest.mark.parametrize("outliers", [0, 12])
def test_the_direction_is_found_among_outliers(outliers):
    view = two_views(11, 30, error_rad=1e-4)
    rays1 = view.rays1.copy()
    rays1[:outliers] = sphere.normalize(np.random.default_rng(0).normal(size=(outliers, 3)))
    view = view._replace(rays1=rays1)
    t = search_direction(view, 3.0, seed=1)
    assert sphere.angle_between(t, view.t) < 0.02
    np.testing.assert_array_equal(t, search_direction(view, 3.0, seed=1))


@kernel
def draw_sample(sample: np.ndarray, among: np.ndarray, n: int, state: np.ndarray) -> None:
    search._draw_distinct(sample, among, n, state)


def test_a_sample_is_distinct_and_of_those_that_it_is_drawn_among():
    among = np.zeros(40)
    among[[3, 4, 8, 20, 21, 39]] = 1.0
    state, found_with_mode = np.array([5], np.uint64), set()
    for _ in range(200):
        sample = np.empty(5, np.int64)
        draw_sample(sample, among, 40, state)
        assert len(set(sample)) == 5
        found_with_mode |= set(sample.tolist())
    assert found_with_mode == set(np.flatnonzero(among).tolist())


@quick
@given(
    outliers=st.floats(0.0, 0.85),
    known=st.floats(0.1, 1.0),
    confidence=st.sampled_from([0.9, 0.99, 0.9999]),
)
def test_the_stop_rule_keeps_its_confidence(outliers, known, confidence):
    # A sample succeeds if it has no outliers and converges. Consistent matches have fewer outliers,
    # if a pose is consistent with more matches than chance.
    inlier = 1.0 - outliers
    among = min(inlier / known, 1.0) * min(inlier / RELATED_CONSENSUS, 1.0)
    hit = 0.25 * 0.5 * (inlier**5 + among**5)
    needed = iterations_needed(outliers, confidence, most=10**7, known=known)
    assert 1.0 - (1.0 - hit) ** needed >= confidence - 1e-9
    # One round fewer misses the confidence, up to the rounding up.
    assert 1.0 - (1.0 - hit) ** (needed - 2) <= confidence + 1e-9


def test_the_stop_rule_keeps_to_its_bounds():
    assert iterations_needed(0.0, 0.99, 24, 2000) == 24
    assert iterations_needed(0.7, 0.99, 24, 2000) > 1000
    assert iterations_needed(0.9, 0.99, 24, 2000) == 2000
    assert iterations_needed(1.0, 0.99, 24, 2000) == 2000
    assert iterations_needed(1.2, 0.99, 24, 2000) == 2000
    counts = [iterations_needed(w, 0.99) for w in np.linspace(0.0, 0.9, 50)]
    assert counts == sorted(counts)


def test_known_matches_need_fewer_hypotheses_unless_consistent_by_chance():
    known = [iterations_needed(0.5, 0.99, known=share) for share in (1.0, 0.7, 0.5)]
    assert known[0] > 3 * known[1] > 6 * known[2]
    # If all matches consistent with an inaccurate pose are known, a better one gains little.
    alone = [iterations_needed(1.0 - inlier, 0.99, known=inlier) for inlier in (0.4, 0.3, 0.2, 0.1)]
    assert alone == sorted(alone)
    assert alone[-1] > 100 * alone[0]


def test_long_flow_needs_more_hypotheses():
    # The farther the start, the fewer samples converge to the pose, down to a limit.
    counts = [iterations_needed(0.2, 0.99, flow_rad=flow) for flow in (0.0, 0.02, 0.1, 0.5)]
    assert counts[0] < counts[1] < counts[2] == counts[3]
    assert counts[-1] == pytest.approx(2.0 * counts[0], abs=4)
    # Nor is the start likely to have led to the pose.
    alone = [
        iterations_needed(0.2, 0.99, flow_rad=flow, has_competing_mode=False) for flow in (0.0, 0.5)
    ]
    assert alone[1] > 3 * alone[0]


def test_a_start_without_a_competing_mode_needs_fewer_samples():
    for outliers in (0.2, 0.5):
        failure = START_FAILURE_RATE / (1.0 - outliers) ** 2
        hit = 0.5 / (1.0 + failure) * (1.0 - outliers) ** 5
        needed = iterations_needed(outliers, 0.999, has_competing_mode=False)
        # Start and samples together miss the pose with one minus the confidence.
        assert failure * (1.0 - hit) ** needed <= 0.001
        assert failure * (1.0 - hit) ** (needed - 2) >= 0.001
        assert iterations_needed(outliers, 0.999) > 2 * needed


def on_a_plane(outliers: int = 0, captured=(), direction=(1.0, 0.3, -0.4)) -> View:
    """A plane 4 m away and a translation of 0.1 m: first outliers, then some on their line.

    The latter are where a translation longer by this many metres would have moved them.
    """
    rng = np.random.default_rng(0)
    count = 40 + outliers + len(captured)
    rays0 = sphere.normalize(np.c_[rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    normal, t = np.array([0.3, -0.2, 1.0]) / 4.0, sphere.normalize(np.array(direction))
    R = so3.exp(np.array([0.4, -0.3, 0.5]))
    X = rays0 / (rays0 @ normal)[:, None]
    rays1 = X @ R.T + 0.1 * t
    rays1[outliers : outliers + len(captured)] += np.reshape(captured, (-1, 1)) * t
    rays1 = sphere.normalize(rays1)
    rays1[:outliers] = sphere.normalize(rays1[:outliers] + rng.normal(0.0, 0.3, (outliers, 3)))
    noise = 1e-4 * sphere.tangent_basis(rays0), 1e-4 * sphere.tangent_basis(rays1)
    return View(rays0, rays1, *noise, R, t)


@pytest.mark.parametrize(
    ("outliers", "captured"), [(0, ()), (20, ()), (0, (20.0, 20.0)), (0, (4.0,)), (0, (-4.0,))]
)
def test_a_plane_allows_another_motion(outliers, captured):
    view = on_a_plane(outliers, captured)
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    assert ambiguous_motions.second_planar_motion(
        view.pairs, view.size, 3.0, view.R, view.t, other_R, other_t
    )
    assert sphere.angle_between(other_t, view.t) > 0.5
    np.testing.assert_allclose(other_R @ other_R.T, np.eye(3), rtol=0.0, atol=1e-12)
    # To second order of a motion of 2.5 % of the distance.
    inlier = slice(outliers + len(captured), None)
    flow = np.linalg.norm((view.rays1 - view.rays0 @ view.R.T)[inlier], axis=1).max()
    # Outliers on their own line are consistent, with a large inverse depth, positive or negative.
    assert np.abs(constraints(view, other_R, other_t)[inlier]).max() < 0.05 * flow
    assert np.abs(constraints(view, view.R, other_t)[inlier]).max() > 0.2 * flow


@pytest.mark.parametrize("metres", [0.1, 1.0, 2.5])
@pytest.mark.parametrize("direction", [(1.0, 0.2, 0.3), (0.1, 0.4, -1.0), (0.2, -0.1, 1.0)])
def test_the_second_motion_of_a_plane_has_the_same_homography(metres, direction):
    """For any translation, towards the plane and away from it."""
    rng = np.random.default_rng(1)
    rays0 = sphere.normalize(np.c_[rng.uniform(-0.5, 0.5, (40, 2)), np.ones(40)])
    normal, t = np.array([0.3, -0.2, 1.0]) / 4.0, sphere.normalize(np.array(direction))
    R = so3.exp(np.array([0.4, -0.3, 0.5]))
    point = (rays0 / (rays0 @ normal)[:, None]) @ R.T - metres * t
    noise = 1e-4 * sphere.tangent_basis(rays0)
    view = View(rays0, sphere.normalize(point), noise, noise, R, -t)
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    assert ambiguous_motions.second_planar_motion(
        view.pairs, view.size, 3.0, R, -t, other_R, other_t
    )
    np.testing.assert_allclose(other_R @ other_R.T, np.eye(3), rtol=0.0, atol=1e-12)
    assert np.linalg.norm(other_t) == pytest.approx(1.0)
    assert sphere.angle_between(other_t, view.t) > 0.1
    assert np.abs(constraints(view, other_R, other_t)).max() < 1e-7


@pytest.mark.parametrize("direction", [(0.2, 0.1, 1.0), (0.2, 0.1, -1.0), (-0.4, 0.1, -0.9)])
def test_matches_flow_towards_the_second_direction_for_either_sign(direction):
    view = on_a_plane(direction=so3.exp(np.array([0.4, -0.3, 0.5])) @ np.array(direction))
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    assert ambiguous_motions.second_planar_motion(
        view.pairs, view.size, 3.0, view.R, view.t, other_R, other_t
    )
    assert sphere.angle_between(other_t, view.t) > 0.1
    assert np.mean((view.rays1 - view.rays0 @ other_R.T) @ other_t > 0.0) > 0.8


def test_a_match_at_the_epipole_has_no_weight_in_the_plane():
    view = on_a_plane()
    view.rays0[0], view.rays1[0] = view.t @ view.R, view.t
    rest = View(*(array[1:] for array in view[:4]), view.R, view.t)
    found = np.empty((2, 4, 3))
    for point, (other_R, other_t) in zip((view, rest), ((f[:3], f[3]) for f in found), strict=True):
        assert ambiguous_motions.second_planar_motion(
            point.pairs, point.size, 3.0, view.R, view.t, other_R, other_t
        )
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-9)


def test_what_is_far_away_has_no_plane():
    view = on_a_plane()
    far = view._replace(rays1=view.rays0 @ view.R.T)
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    assert not ambiguous_motions.second_planar_motion(
        far.pairs, far.size, 3.0, view.R, view.t, other_R, other_t
    )


def test_a_pose_twisted_by_half_a_turn_costs_everything():
    view = two_views(5, 30)
    twisted = so3.exp(math.pi * view.t) @ view.R
    # The epipolar constraint is the same for both: only the side of t on which the rays lie
    # differs.
    assert np.abs(constraints(view, twisted, view.t)).max() < 1e-12
    cost, _ = score(view, twisted, view.t, 9.0)
    assert cost == pytest.approx(9.0 * 30)
    assert score(view, view.R, view.t, 9.0)[0] < 1e-12


@pytest.mark.parametrize("ahead", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("outliers", [0, 25])
def test_two_layers_can_change_places(outliers, ahead):
    # A narrow view past a near and a far layer: a rotation imitates the flow of either.
    rng = np.random.default_rng(3)
    count = 40 + outliers
    rays0 = sphere.normalize(np.c_[rng.uniform(-0.05, 0.05, (count, 2)), np.ones(count)])
    near, far = np.arange(20), np.arange(20, 40)
    t, R = sphere.normalize(np.array([1.0, 0.0, ahead])), so3.exp(np.array([0.02, -0.01, 0.03]))
    depth = np.full((count, 1), 1000.0)
    depth[near] = 2.0
    rays1 = sphere.normalize(depth * rays0 @ R.T + 0.05 * t)
    rays1[40:] = sphere.normalize(rays1[40:] + rng.normal(0.0, 0.05, (outliers, 3)))
    noise = 1e-4 * sphere.tangent_basis(rays0)
    view = rays_only(rays0, rays1)._replace(noise0=noise, noise1=noise)
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    assert ambiguous_motions.bas_relief_motion(view.pairs, count, 3.0, R, t, other_R, other_t)
    # The part along the mean ray stays, within the noise.
    np.testing.assert_allclose(other_t, t * (-1.0, 1.0, 1.0), atol=0.06)
    flow = rays1 - rays0 @ other_R.T
    parallax = 0.05 / 2.0 * t[0]
    # The near layer is stationary now, and the far one flows towards the second direction.
    assert np.linalg.norm(flow[near], axis=1).max() < 0.15 * parallax
    assert (-flow[far, 0] > 0.9 * parallax).all()


@kernel
def start_from(
    matches: PackedMatches, best: Pose, tolerance: float, nothing: np.ndarray, found: np.ndarray
) -> None:
    default_noise(tolerance, nothing)
    initial_noise(matches, best, tolerance, found)


@pytest.mark.parametrize(
    ("best", "is_known"),
    # Noise of 0.3 or 3 units, with 2/3 inliers among 20 matches, or the sample alone.
    [
        ((0.09, 1 / 3, 0.1, 0.2), True),
        ((9.0, 1 / 3, 0.1, 0.2), False),
        ((0.09, 0.7, 0.1, 0.2), False),
    ],
)
def test_the_initial_noise_is_at_most_the_default(best, is_known):
    nothing, found = np.empty((2, 4))
    matches = PackedMatches(
        *np.empty((3, 0)), 20, 100.0, SHORT_TAIL, 1e-6, math.inf, soft_cheirality=True
    )
    pose = Pose(np.eye(3), np.zeros(3), np.array(best), np.zeros((6, 6)), np.zeros(1))
    start_from(matches, pose, 3.0, nothing, found)
    assert found.tolist() == (list(best) if is_known else nothing.tolist())
