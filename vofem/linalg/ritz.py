"""Load-dependent Ritz vectors: static responses and, growing out of them, the lowest modes that they excite.

The Krylov vectors ``K^-1 f, K^-1 M K^-1 f, ...`` of every load f span the
static response to it exactly, match the response near zero frequency to twice
their number of terms, and converge to the modes that f excites, the lowest
first. Each is made M-orthogonal to all before it, twice.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthq. Eng. Struct. Dyn. 10 (1982) 813, doi:10.1002/eqe.4290100606.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from vofem.arrays import Array

#: Remainder of a vector, divided by its size, below which it counts as a combination of the earlier vectors.
_DEPENDENT = 1e-10


class RitzBasis:
    """M-orthonormal vectors, rigid motions first. More vectors are computed on request.

    `mass` has shape (n, n).
    `solve`: ``K^-1 f`` of a load that leaves rigid motions at rest, shape (n,) to (n,).
    `rigid` (shape (n, r)): a basis of the motions without stiffness.
    `loads` (shape (n,)): loads whose static responses belong to the space.
    `states` (shape (n,)): displacements or velocities that belong to the space.
    """

    def __init__(
        self,
        mass: Any,
        solve: Callable[[Array], Array],
        rigid: Array,
        loads: Iterable[Array],
        states: Iterable[Array],
    ) -> None:
        self._mass = mass.tocsr()
        self._solve = solve
        self._vectors = np.zeros((mass.shape[0], 0), order="F")
        self._count = 0
        self._reserve(max(32, 2 * rigid.shape[1]))
        for motion in rigid.T:
            self._append(np.array(motion))
        self.rigid = self._count
        self._queue = deque([self._response(load) for load in loads] + [np.array(state) for state in states])

    def grow(self, count: int) -> Array:
        """Return `count` vectors, shape (n, count), or fewer if the loads and states generate no more."""
        self._reserve(count)
        while self._count < count and self._queue:
            if self._append(self._queue.popleft()):
                self._queue.append(self._response(self._mass @ self._vectors[:, self._count - 1]))
        return self._vectors[:, : min(count, self._count)]

    def _reserve(self, count: int) -> None:
        if count > self._vectors.shape[1]:
            more = np.zeros((self._mass.shape[0], count), order="F")
            more[:, : self._count] = self._vectors[:, : self._count]
            self._vectors = more

    def _response(self, load: Array) -> Array:
        """Return the static response to a load, without the part that accelerates the rigid motions."""
        rigid = self._vectors[:, : self.rigid]
        return self._solve(load - self._mass @ (rigid @ (rigid.T @ load)) if self.rigid else load)

    def _append(self, x: Array) -> bool:
        """Add a vector unless it is a combination of the earlier ones."""
        earlier = self._vectors[:, : self._count]
        image = self._mass @ x
        size = before = left = float(x @ image)
        passes = 0
        # Twice is enough, unless so little was left that it is not orthogonal yet.
        while passes < 2 or left < 0.25 * before:
            x = x - earlier @ (earlier.T @ image)
            image = self._mass @ x
            before, left = left, float(x @ image)
            passes += 1
            if not left > _DEPENDENT**2 * size:
                return False
        self._vectors[:, self._count] = x / np.sqrt(left)
        self._count += 1
        return True
