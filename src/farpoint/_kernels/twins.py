"""Motions that look alike: where one minimum of the cost is, another may be, and where to look."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.linear import apply_rotation_step, clear, kabsch, solve_spd
from farpoint._kernels.pairs import RayPairs
from farpoint._kernels.vectors import combine, cross, dot, norm, rotate, rotate_back, row, vector

__all__ = ["layer_twin", "planar_twin"]


@kernel
def planar_twin(
    pairs: RayPairs, R: np.ndarray, t: np.ndarray, twin_R: np.ndarray, twin_t: np.ndarray
) -> bool:
    """The other motion that a plane through the matches would allow; False where there is none.

    The plane ``n . X = 1`` (camera 0, unit of the translation) is fitted to the inverse distances
    ``n . a`` of the matches. With ``tau = R^T t`` the plane induces ``R (I + tau n^T)``, and since
    ``tau n^T - n tau^T = [n x tau]x`` the twin exchanges translation and normal and turns by
    ``n x tau``: exact for small motions (Longuet-Higgins, Proc. R. Soc. B 223, 1984,
    DOI 10.1098/rspb.1984.0088), a start for the refinement otherwise.
    """
    M = np.empty((3, 3))
    v = np.empty(3)
    L = np.empty((3, 3))
    n = np.empty(3)
    clear(M)
    clear(v)
    tau = rotate_back(R, vector(t))
    for i in range(pairs.rays0.shape[0]):
        a = row(pairs.rays0, i)
        back = rotate_back(R, row(pairs.rays1, i))
        # back = l0 a + tau up to length: its cross product gives a x back = (back x tau) / l0.
        across = cross(back, tau)
        square = dot(across, across)
        if not square > 1e-12:
            continue
        inverse_distance = dot(cross(a, back), across) / square
        # Each weighs by its own accuracy; a wrong one is bounded by its own size.
        weight = square / (1.0 + inverse_distance * inverse_distance)
        for k in range(3):
            v[k] += weight * inverse_distance * a[k]
            for j in range(3):
                M[k, j] += weight * a[k] * a[j]
    if not solve_spd(M, v, 1e-9, L, n):
        return False
    plane = vector(n)
    if not norm(plane) > 1e-9:
        return False
    # R Exp(turn) = Exp(R turn) R.
    turn = rotate(R, cross(plane, tau))
    apply_rotation_step(R, turn[0], turn[1], turn[2], twin_R)
    normal = rotate(twin_R, plane)
    for k in range(3):
        twin_t[k] = normal[k] / norm(plane)
    return True


@kernel
def layer_twin(
    pairs: RayPairs, R: np.ndarray, t: np.ndarray, twin_R: np.ndarray, twin_t: np.ndarray
) -> bool:
    """The motion that takes the near layer for the far one; False where there are no two layers.

    In a narrow field of view a rotation imitates the flow of points at one distance. If it is that
    of the near points which the rotation takes up, the far ones flow backwards.
    """
    n = pairs.rays0.shape[0]
    M = np.empty((3, 3))
    clear(M)
    nearness = np.empty(n)
    mean = 0.0
    for i in range(n):
        m = rotate(R, row(pairs.rays0, i))
        across = cross(vector(t), m)
        flow = combine(1.0, row(pairs.rays1, i), -1.0, m)
        # Inverse distance, bounded where a wrong match claims to be at the epipole.
        nearness[i] = dot(flow, vector(t)) / max(dot(across, across), 1e-6)
        mean += nearness[i] / n
    for i in range(n):
        if nearness[i] > mean:
            for j in range(3):
                for k in range(3):
                    M[j, k] += pairs.rays1[i, j] * pairs.rays0[i, k]
    for k in range(3):
        twin_t[k] = -t[k]
    return kabsch(M, twin_R)
