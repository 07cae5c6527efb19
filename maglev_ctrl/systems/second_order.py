"""Linear models as records: M q'' + C q' + K q = forces, with internal states.

One sign convention for the whole package: matrices stand on the left-hand side, so positive stiffness restores
and positive damping dissipates; forces from internal states, actuators and the guideway stand on the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, join_columns, join_rows, read_only
from maglev_ctrl.display import Shown

ContributionKind = Literal[
    "body", "magnet", "spring_damper", "actuator", "geometry", "aerodynamics", "controller", "other"
]


@dataclass(frozen=True, eq=False, slots=True)
class Contribution:
    """One element's share of a linear model.

    Left-hand side `M`, `C`, `K` (..., n, n) in kg, N s/m, N/m (or their rotational kin) and the force `F`
    (..., n, m) in N per unit of each internal state, right-hand side.
    """

    name: str
    kind: ContributionKind
    M: FloatArray
    C: FloatArray
    K: FloatArray
    F: FloatArray


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class SecondOrderSystem(Shown):
    """Linearised vehicle: second-order coordinates q, internal states xi, inputs u, guideway displacement w, outputs y.

        M q'' + C q' + K q = F xi + B u + K_w w + C_w w'
        xi' = A_internal xi + G_q q + G_v q' + G_a q'' + B_internal u + G_w w + G_wv w'
        y   = H_q q + H_v q' + H_a q'' + H_internal xi + H_w w + H_wv w'

    Internal states are damper lags, actuator bandwidths, delays (Pade) and, once a loop is closed, the controller.
    Every matrix may carry leading batch axes `...`. Built with `from_matrices` or by `vehicle.linearize`.

    `ignorable` names coordinates whose position enters nowhere (surge along a uniform track): the state vector
    leaves their position out, so that the rigid translation adds no eigenvalue at zero.
    """

    _told: ClassVar = ("dofs", "internal", "inputs", "guideway", "outputs")

    M: FloatArray
    C: FloatArray
    K: FloatArray
    dofs: tuple[str, ...]
    internal: tuple[str, ...]
    A_internal: FloatArray
    G_q: FloatArray
    G_v: FloatArray
    G_a: FloatArray
    F: FloatArray
    inputs: tuple[str, ...]
    B: FloatArray
    B_internal: FloatArray
    guideway: tuple[str, ...]
    K_w: FloatArray
    C_w: FloatArray
    G_w: FloatArray
    G_wv: FloatArray
    outputs: tuple[str, ...]
    H_q: FloatArray
    H_v: FloatArray
    H_a: FloatArray
    H_internal: FloatArray
    H_w: FloatArray
    H_wv: FloatArray
    contributions: tuple[Contribution, ...] = ()
    ignorable: tuple[str, ...] = ()

    @classmethod
    def from_matrices(
        cls,
        M: ArrayLike,
        C: ArrayLike,
        K: ArrayLike,
        *,
        dofs: tuple[str, ...] | None = None,
        internal: tuple[str, ...] = (),
        A_internal: ArrayLike | None = None,
        G_q: ArrayLike | None = None,
        G_v: ArrayLike | None = None,
        G_a: ArrayLike | None = None,
        F: ArrayLike | None = None,
        inputs: tuple[str, ...] = (),
        B: ArrayLike | None = None,
        B_internal: ArrayLike | None = None,
        guideway: tuple[str, ...] = (),
        K_w: ArrayLike | None = None,
        C_w: ArrayLike | None = None,
        G_w: ArrayLike | None = None,
        G_wv: ArrayLike | None = None,
        outputs: tuple[str, ...] = (),
        H_q: ArrayLike | None = None,
        H_v: ArrayLike | None = None,
        H_a: ArrayLike | None = None,
        H_internal: ArrayLike | None = None,
        H_w: ArrayLike | None = None,
        H_wv: ArrayLike | None = None,
        contributions: tuple[Contribution, ...] = (),
        ignorable: tuple[str, ...] = (),
    ) -> SecondOrderSystem:
        """A system from its matrices; whatever is left out is zero, shapes are checked.

        Parameters
        ----------
        M, C, K : (..., n, n); kg, N s/m, N/m
        dofs : n names; q1, q2, ... when left out
        contributions : shares that add up to M, C, K, F; one share named "matrices" when left out
        ignorable : names of coordinates whose position enters nowhere

        Raises
        ------
        ValueError : a shape does not fit, a name is doubled, or an ignorable coordinate has stiffness

        Examples
        --------
        >>> SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]]).state_matrix()
        array([[ 0.,  1.],
               [-4., -0.]])
        """
        M_array = read_only(M, name="M", shape=(None, None))
        n = M_array.shape[-1]
        names = dofs if dofs is not None else tuple(f"q{i + 1}" for i in range(n))
        n_xi, n_u, n_w, n_y = len(internal), len(inputs), len(guideway), len(outputs)

        def matrix(value: ArrayLike | None, name: str, rows: int, columns: int) -> FloatArray:
            filled = np.zeros((rows, columns)) if value is None else value
            return read_only(filled, name=name, shape=(rows, columns))

        arrays = {
            "M": matrix(M, "M", n, n),
            "C": matrix(C, "C", n, n),
            "K": matrix(K, "K", n, n),
            "A_internal": matrix(A_internal, "A_internal", n_xi, n_xi),
            "G_q": matrix(G_q, "G_q", n_xi, n),
            "G_v": matrix(G_v, "G_v", n_xi, n),
            "G_a": matrix(G_a, "G_a", n_xi, n),
            "F": matrix(F, "F", n, n_xi),
            "B": matrix(B, "B", n, n_u),
            "B_internal": matrix(B_internal, "B_internal", n_xi, n_u),
            "K_w": matrix(K_w, "K_w", n, n_w),
            "C_w": matrix(C_w, "C_w", n, n_w),
            "G_w": matrix(G_w, "G_w", n_xi, n_w),
            "G_wv": matrix(G_wv, "G_wv", n_xi, n_w),
            "H_q": matrix(H_q, "H_q", n_y, n),
            "H_v": matrix(H_v, "H_v", n_y, n),
            "H_a": matrix(H_a, "H_a", n_y, n),
            "H_internal": matrix(H_internal, "H_internal", n_y, n_xi),
            "H_w": matrix(H_w, "H_w", n_y, n_w),
            "H_wv": matrix(H_wv, "H_wv", n_y, n_w),
        }
        for label, group in (
            ("dofs", names), ("internal", internal), ("inputs", inputs), ("guideway", guideway), ("outputs", outputs)
        ):  # fmt: skip
            if len(set(group)) < len(group):
                doubled = sorted({x for x in group if group.count(x) > 1})
                raise ValueError(f"{label}: name used twice: {', '.join(doubled)}")
        if len(names) != n:
            raise ValueError(f"dofs: expected {n} names, got {len(names)}")
        shares = contributions or (
            Contribution("matrices", "other", arrays["M"], arrays["C"], arrays["K"], arrays["F"]),
        )
        for name in ignorable:
            if name not in names:
                raise ValueError(f"ignorable: {name!r} is not one of {', '.join(names)}")
            column = names.index(name)
            if any(np.any(arrays[key][..., :, column] != 0.0) for key in ("K", "G_q", "H_q")):
                raise ValueError(f"ignorable: the position of {name!r} enters K, G_q or H_q")
        return cls(
            dofs=names, internal=internal, inputs=inputs, guideway=guideway, outputs=outputs,
            contributions=shares, ignorable=ignorable, **arrays,
        )  # fmt: skip

    @property
    def positions(self) -> tuple[int, ...]:
        """Indices of the coordinates whose position is a state."""
        return tuple(i for i, name in enumerate(self.dofs) if name not in self.ignorable)

    @property
    def states(self) -> tuple[str, ...]:
        """State names: positions (without ignorable ones), velocities, internal states."""
        return (
            tuple(self.dofs[i] for i in self.positions)
            + tuple(f"{name}.velocity" for name in self.dofs)
            + self.internal
        )

    def acceleration_rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q'' = X x + U u + W [w; w'] with x the state vector; the three matrices (..., n, *)."""
        X = self._acceleration_by_state()
        U: FloatArray = np.linalg.solve(self.M, self.B).astype(np.float64)
        W: FloatArray = np.linalg.solve(self.M, join_columns([self.K_w, self.C_w])).astype(np.float64)
        return X, U, W

    def _acceleration_by_state(self) -> FloatArray:
        kept = list(self.positions)
        rows = [-self.K[..., kept], -self.C, self.F]
        return np.linalg.solve(self.M, join_columns(rows)).astype(np.float64)

    def state_matrix(self) -> FloatArray:
        """A of x' = A x with x = [positions, velocities, internal states]; (..., nx, nx).

        Examples
        --------
        >>> SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]]).state_matrix().shape
        (2, 2)
        """
        kept = list(self.positions)
        n, n_q, n_xi = len(self.dofs), len(kept), len(self.internal)
        X = self._acceleration_by_state()
        top = np.zeros((n_q, n_q + n + n_xi))
        for row, column in enumerate(kept):
            top[row, n_q + column] = 1.0
        inner = join_columns([self.G_q[..., kept], self.G_v, self.A_internal]) + self.G_a @ X
        return join_rows([top, X, inner])

    def input_matrix(self) -> FloatArray:
        """B of x' = A x + B u; (..., nx, nu)."""
        _, U, _ = self.acceleration_rows()
        top = np.zeros((len(self.positions), len(self.inputs)))
        return join_rows([top, U, self.B_internal + self.G_a @ U])

    def guideway_matrix(self) -> FloatArray:
        """E of x' = A x + E [w; w']: guideway displacements first, then their rates; (..., nx, 2 nw)."""
        _, _, W = self.acceleration_rows()
        n_w = len(self.guideway)
        top = np.zeros((len(self.positions), 2 * n_w))
        inner = join_columns([self.G_w, self.G_wv]) + self.G_a @ W
        return join_rows([top, W, inner])

    def output_rows(self, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """y = C x + D u + E [w; w'] for named outputs or states; (..., ny, nx), (..., ny, nu), (..., ny, 2 nw).

        Raises
        ------
        ValueError : a name is neither an output nor a state

        Examples
        --------
        >>> C, D, E = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]]).output_rows(("q1",))
        >>> C
        array([[1., 0.]])
        """
        states, kept = self.states, list(self.positions)
        X, U, W = self.acceleration_rows()
        parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        for name in names:
            if name in self.outputs:
                i = slice(self.outputs.index(name), self.outputs.index(name) + 1)
                H_a = self.H_a[..., i, :]
                parts.append((
                    join_columns([self.H_q[..., i, :][..., kept], self.H_v[..., i, :], self.H_internal[..., i, :]])
                    + H_a @ X,
                    H_a @ U,
                    join_columns([self.H_w[..., i, :], self.H_wv[..., i, :]]) + H_a @ W,
                ))  # fmt: skip
            elif name in states:
                row = np.zeros((1, len(states)))
                row[0, states.index(name)] = 1.0
                parts.append((row, np.zeros((1, len(self.inputs))), np.zeros((1, 2 * len(self.guideway)))))
            else:
                raise ValueError(f"output: {name!r} is neither an output nor a state of this system")
        if not parts:
            return (
                np.zeros((0, len(states))), np.zeros((0, len(self.inputs))), np.zeros((0, 2 * len(self.guideway)))
            )  # fmt: skip
        return (
            join_rows([p[0] for p in parts]), join_rows([p[1] for p in parts]), join_rows([p[2] for p in parts])
        )  # fmt: skip

    def modulated_state_matrix(self, K_1: ArrayLike) -> FloatArray:
        """A_1 such that K + K_1 gives the state matrix A + A_1 (exact: A is affine in K); (..., nx, nx).

        Raises
        ------
        ValueError : K_1 is not (..., n, n) or acts on an ignorable position
        """
        n = len(self.dofs)
        stiffness = read_only(K_1, name="K_1", shape=(n, n))
        kept = list(self.positions)
        gone = [i for i in range(n) if i not in kept]
        if np.any(stiffness[..., gone] != 0.0):
            raise ValueError("K_1: acts on the position of an ignorable coordinate")
        X: FloatArray = -np.linalg.solve(self.M, stiffness[..., kept]).astype(np.float64)
        X = join_columns([X, np.zeros((n, n + len(self.internal)))])
        return join_rows([np.zeros((len(kept), X.shape[-1])), X, self.G_a @ X])
