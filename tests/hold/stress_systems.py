"""Linear systems whose stability is known: spectra put in by hand, or counted exactly from the very entries.

Every sample carries `truth`: -1 where all eigenvalues lie left of the axis, 1 where one lies right of it, 0 where the
rightmost lie on it, which no floating-point method can decide. `easy` says that a good method has to decide it: the
growth rate is far from zero by the standards of what rounding does to these matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import stress_truth as exact

Matrix = exact.Matrix


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """One system: `A` (n, n) of x' = A x, or `M`, `C`, `K`; `truth` -1, 0, 1; `easy` where a decision is owed."""

    family: str
    truth: int
    easy: bool
    A: np.ndarray | None = None
    M: np.ndarray | None = None
    C: np.ndarray | None = None
    K: np.ndarray | None = None


Maker = Callable[[np.random.Generator], Sample]


def _first(family: str, A: Matrix, *, easy: bool, known: int | None = None) -> Sample:
    """The sample of A as stored; the truth is `known` where storing rounds nothing, else it is counted."""
    array, same = exact.floats_of(A)
    if known is None or not same:
        known = exact.growth_sign(exact.characteristic(exact.fractions_of(array)))
    return Sample(family, known, easy, A=array)


def _second(family: str, M: np.ndarray, C: np.ndarray, K: np.ndarray, *, easy: bool) -> Sample:
    """The sample of M, C, K as stored; the truth is counted."""
    polynomial = exact.pencil_polynomial([exact.fractions_of(X) for X in (K, C, M)])
    return Sample(family, exact.growth_sign(polynomial), easy, M=M, C=C, K=K)


def _margin(random: np.random.Generator) -> tuple[Fraction, int]:
    """+-2^-k, from 1/2 to 2^-55, and k."""
    k = int(random.integers(1, 56))
    return Fraction(int(random.choice([-1, 1])), 2**k), k


def _blocks(random: np.random.Generator, n: int, lead: list[Matrix]) -> Matrix:
    """Block diagonal: the leading blocks, filled up to n by well damped ones."""
    blocks = list(lead)
    while sum(len(b) for b in blocks) < n:
        a, w = Fraction(int(random.integers(1, 9)), 4), Fraction(int(random.integers(1, 9)))
        room = n - sum(len(b) for b in blocks)
        blocks.append([[-a]] if room == 1 or random.random() < 0.3 else [[-a, w], [-w, -a]])
    size = sum(len(b) for b in blocks)
    whole = [[Fraction(0)] * size for _ in range(size)]
    at = 0
    for block in blocks:
        for i, row in enumerate(block):
            whole[at + i][at : at + len(row)] = row
        at += len(block)
    return whole


def _sheared(random: np.random.Generator, A: Matrix, shears: int) -> Matrix:
    """T A T^-1 with T a product of integer shears: the inverse is whole, too, so nothing rounds here."""
    A, n = [list(row) for row in A], len(A)
    for _ in range(shears if n > 1 else 0):
        i, j = random.choice(n, 2, replace=False)
        factor = int(random.choice([-2, -1, 1, 2]))
        A[i] = [a + factor * b for a, b in zip(A[i], A[j], strict=True)]
        for row in A:
            row[j] -= factor * row[i]
    return A


def _scaled(random: np.random.Generator, A: Matrix, reach: int) -> Matrix:
    """D A D^-1 with D powers of two from 2^-reach to 2^reach (2^40 is 1e12): units gone wild, without rounding."""
    d = [Fraction(2) ** int(k) for k in random.integers(-reach, reach + 1, len(A))]
    return [[d[i] * value / d[j] for j, value in enumerate(row)] for i, row in enumerate(A)]


def near_marginal(random: np.random.Generator) -> Sample:
    """One pair that grows or decays at 2^-k of its frequency, hidden by integer shears."""
    margin, k = _margin(random)
    n, w = int(random.integers(1, 25)), Fraction(int(random.integers(1, 9)))
    lead = [[margin]] if n == 1 or random.random() < 0.3 else [[margin, w], [-w, margin]]
    A = _sheared(random, _blocks(random, n, [lead]), int(random.integers(0, n + 1)))
    return _first("near marginal", A, easy=k <= 20, known=1 if margin > 0 else -1)


def wild_units(random: np.random.Generator) -> Sample:
    """The same, each state in a unit of its own, 1e-12 to 1e12."""
    margin, k = _margin(random)
    n, w = int(random.integers(2, 17)), Fraction(int(random.integers(1, 9)))
    A = _sheared(random, _blocks(random, n, [[[margin, w], [-w, margin]]]), int(random.integers(0, n + 1)))
    return _first("wild units", _scaled(random, A, 40), easy=k <= 20, known=1 if margin > 0 else -1)


def jordan(random: np.random.Generator) -> Sample:
    """A Jordan block of size 2 to 5 (real, or a pair) at a margin of 2^-k, or on the axis."""
    size, k = int(random.integers(2, 6)), int(random.integers(1, 50))
    margin = Fraction(int(random.choice([-1, 0, 1])), 2**k)
    pair = bool(random.random() < 0.5) and size < 5
    step = 2 if pair else 1
    block = [[Fraction(0)] * (size * step) for _ in range(size * step)]
    for i in range(size * step):
        block[i][i] = margin
        if i + step < size * step:
            block[i][i + step] = Fraction(1)
    for i in range(0, size * step, 2) if pair else []:
        block[i][i + 1], block[i + 1][i] = Fraction(3), Fraction(-3)
    n = size * step + int(random.integers(0, 5))
    A = _sheared(random, _blocks(random, n, [block]), int(random.integers(0, n)))
    if random.random() < 0.5:
        A = _scaled(random, A, 30)
    # A block of size m moves by the m-th root of the rounding: only margins far above that can be decided.
    easy = margin != 0 and k * size <= 20
    return _first("Jordan block", A, easy=easy, known=(margin > 0) - (margin < 0))


def companion(random: np.random.Generator) -> Sample:
    """Companion matrices of polynomials with whole roots: multiple, clustered, Wilkinson's, pairs on the axis."""
    p = [Fraction(1)]
    kind = int(random.integers(0, 4))
    sign = 0
    factors: list[list[Fraction]] = []
    if kind == 0:  # (s + a)^n
        n, a = int(random.integers(2, 13)), int(random.choice([-1, 1, 2, 3]))
        factors, sign = [[Fraction(a), Fraction(1)]] * n, -1 if a > 0 else 1
    elif kind == 1:  # Wilkinson's roots, one of them perhaps moved across the axis
        n = int(random.integers(4, 16))
        moved = int(random.integers(0, 2))
        margin = Fraction(int(random.choice([-1, 1])), 2 ** int(random.integers(4, 30)))
        factors = [[Fraction(j), Fraction(1)] for j in range(1, n)] + [[margin, Fraction(1)]] * moved
        sign = 1 if moved and margin < 0 else -1
    elif kind == 2:  # (s^2 + 1)^m (s + 1): a defective pair on the axis
        factors = [[Fraction(1), Fraction(0), Fraction(1)]] * int(random.integers(1, 4)) + [[Fraction(1), Fraction(1)]]
    else:  # s^m (s + 2)
        factors = [[Fraction(0), Fraction(1)]] * int(random.integers(1, 4)) + [[Fraction(2), Fraction(1)]]
    for factor in factors:
        p = exact.times(p, factor)
    n = len(p) - 1
    A = [[Fraction(int(j == i + 1)) for j in range(n)] for i in range(n - 1)] + [[-c for c in p[:-1]]]
    return _first("companion", A, easy=kind == 0 and n <= 3 and abs(p[0]) <= 8, known=sign)


def non_normal(random: np.random.Generator) -> Sample:
    """Triangular with entries up to 1e12 above the diagonal: a transient of any height hides the growth rate."""
    n = int(random.integers(2, 13))
    margin, k = _margin(random)
    reach = int(random.integers(0, 41))
    A = [[Fraction(0)] * n for _ in range(n)]
    for i in range(n):
        A[i][i] = -Fraction(int(random.integers(1, 65)), 8)
        for j in range(i + 1, n):
            A[i][j] = Fraction(int(random.integers(-8, 9))) * Fraction(2) ** int(random.integers(0, reach + 1))
    worst = int(random.integers(0, n))
    A[worst][worst] = margin
    diagonal = [A[i][i] for i in range(n)]
    sign = 1 if max(diagonal) > 0 else -1
    order = random.permutation(n)
    A = [[A[i][j] for j in order] for i in order]
    return _first("non-normal", A, easy=k <= 8 and reach <= 8 and n <= 4, known=sign)


def time_constants(random: np.random.Generator) -> Sample:
    """Decay rates from 1e-12 to 1e12 in one system, coupled one way; the slowest may grow."""
    n = int(random.integers(2, 13))
    rates = [-(Fraction(2) ** int(k)) for k in random.integers(-40, 41, n)]
    slowest = int(np.argmax([float(r) for r in rates]))
    if random.random() < 0.5:
        rates[slowest] = -rates[slowest]
    A = [[rates[i] if i == j else Fraction(0) for j in range(n)] for i in range(n)]
    coupled = random.random() < 0.6
    for i in range(n - 1) if coupled else []:
        A[i][i + 1] = Fraction(int(random.integers(-4, 5))) * abs(rates[i + 1])
    spread = max(rates, key=abs) / min(rates, key=abs)
    return _first("time constants", A, easy=not coupled and abs(spread) < 2**30, known=1 if max(rates) > 0 else -1)


def dense_random(random: np.random.Generator) -> Sample:
    """A random matrix moved until its rightmost eigenvalue is 1e-k away from the axis; the truth is counted."""
    n, k = int(random.integers(1, 13)), int(random.integers(2, 17))
    A = random.standard_normal((n, n)) * 10.0 ** random.uniform(-3, 3)
    size = float(np.max(np.abs(np.linalg.eigvals(A))))
    wanted = float(random.choice([-1.0, 1.0])) * 10.0**-k * size
    A = A - (float(np.max(np.linalg.eigvals(A).real)) - wanted) * np.eye(n)
    d = 10.0 ** random.uniform(-12, 12, n) if random.random() < 0.5 else np.ones(n)
    A = A * d[:, None] / d
    return _first("dense, 1e-k off", exact.fractions_of(A), easy=k <= 7)


def _integers(random: np.random.Generator, n: int) -> np.ndarray:
    """A whole matrix of determinant one."""
    T = np.eye(n)
    for _ in range(2 * n if n > 1 else 0):
        i, j = random.choice(n, 2, replace=False)
        T[i] += float(random.choice([-1.0, 1.0])) * T[j]
    return T


def light_damping(random: np.random.Generator) -> Sample:
    """Coupled oscillators, all damped but one, whose damping ratio is +-1e-k, k = 2 .. 16."""
    n, k = int(random.integers(1, 13)), int(random.integers(2, 17))
    w = np.sort(random.uniform(1.0, 20.0, n))
    zeta = random.uniform(0.01, 0.1, n)
    zeta[int(random.integers(0, n))] = float(random.choice([-1.0, 1.0])) * 10.0**-k
    T = _integers(random, n)
    M, C, K = T.T @ T, T.T @ np.diag(2.0 * zeta * w) @ T, T.T @ np.diag(w**2) @ T
    if random.random() < 0.5:
        d = 10.0 ** random.uniform(-6, 6, n)
        M, C, K = (d[:, None] * X * d for X in (M, C, K))
    return _second("light damping", M, C, K, easy=k <= 6)


def rigid_body(random: np.random.Generator) -> Sample:
    """A free body beside damped ones: eigenvalues at zero, simple with drag on it, defective without."""
    n = int(random.integers(2, 9))
    T = _integers(random, n)
    stiff, damp = random.integers(1, 50, n).astype(float), random.integers(1, 9, n) / 8.0
    stiff[0] = 0.0
    if random.random() < 0.5:
        damp[0] = 0.0
    M, C, K = T.T @ T, T.T @ np.diag(damp) @ T, T.T @ np.diag(stiff) @ T
    return _second("rigid body", M, C, K, easy=False)


def gyroscopic(random: np.random.Generator) -> Sample:
    """Statically unstable, held by gyroscopic forces alone: on the axis where g > 2 sqrt k, flutter below; damped."""
    g = float(random.integers(3, 12))
    off = float(random.choice([-1.0, 0.0, 1.0])) * 2.0 ** -float(random.integers(1, 45))
    k = g * g / 4.0 * (1.0 + off)
    C = np.array([[0.0, g], [-g, 0.0]])
    damping = float(random.choice([0.0, 0.0, 1e-3, 0.25]))
    return _second(
        "gyroscopic", np.eye(2), C + damping * np.eye(2), -k * np.eye(2), easy=abs(off) >= 0.01 and damping != 0.0
    )


def follower(random: np.random.Generator) -> Sample:
    """Circulatory coupling p against detuned, damped springs: flutter above a load known in closed form.

    With K = [[a, p], [-p, b]] and equal damping c the threshold is 4 p^2 = (a - b)^2 + 2 c^2 (a + b).
    """
    a, b = float(random.integers(1, 30)), float(random.integers(31, 60))
    c = float(random.choice([0.0, 0.125, 0.5, 2.0**-10]))
    off = float(random.choice([-1.0, 1.0])) * 10.0 ** -float(random.integers(1, 16))
    p = np.sqrt((a - b) ** 2 + 2.0 * c * c * (a + b)) / 2.0 * (1.0 + off)
    d = 10.0 ** random.uniform(-9, 9, 2) if random.random() < 0.5 else np.ones(2)
    K = np.array([[a, p], [-p, b]])
    M, C, K = (d[:, None] * X * d for X in (np.eye(2), c * np.eye(2), K))
    return _second("follower force", M, C, K, easy=abs(off) > 1e-7 and (c >= 0.1 or off > 0.0))


def thin_mass(random: np.random.Generator) -> Sample:
    """A mass matrix that is singular to 2^-k: one coordinate has next to no inertia of its own."""
    n, k = int(random.integers(2, 7)), int(random.integers(1, 52))
    M = np.eye(n)
    M[0, 1] = M[1, 0] = 1.0
    M[1, 1] = 1.0 + 2.0**-k
    T = _integers(random, n) if random.random() < 0.5 else np.eye(n)
    damp, stiff = random.uniform(0.05, 1.0, n), random.uniform(1.0, 9.0, n)
    worst = float(random.choice([-1.0, 1.0])) * 10.0 ** -float(random.integers(1, 12))
    damp[int(random.integers(0, n))] = worst
    M, C, K = T.T @ M @ T, T.T @ np.diag(damp) @ T, T.T @ np.diag(stiff) @ T
    return _second("thin mass", M, C, K, easy=k <= 10 and abs(worst) > 1e-6 and n <= 3)


def mixed_second(random: np.random.Generator) -> Sample:
    """Random mass, damping (of any sign), gyroscopic, stiffness and circulatory matrices in mixed units."""
    n = int(random.integers(1, 9))
    G = random.standard_normal((n, n))
    M = G @ G.T + 0.1 * np.eye(n)
    C = random.standard_normal((n, n)) * 10.0 ** random.uniform(-8, 1)
    C = C + float(random.choice([0.0, 1.0])) * n * np.abs(np.max(C)) * np.eye(n)
    K = random.standard_normal((n, n)) + 3.0 * n * np.eye(n)
    if random.random() < 0.6:
        K = (K + K.T) / 2.0
    d = 10.0 ** random.uniform(-6, 6, n)
    return _second("mixed second order", *(d[:, None] * X * d for X in (M, C, K)), easy=False)


def slow_cluster(random: np.random.Generator) -> Sample:
    """Eigenvalues within 2^-k of each other around the axis' left or right side."""
    n, k = int(random.integers(2, 9)), int(random.integers(2, 30))
    centre = Fraction(int(random.choice([-1, 1])), 2 ** int(random.integers(1, 20)))
    values = [centre * (1 + Fraction(int(random.integers(0, 9)), 2**k)) for _ in range(n)]
    A = _sheared(random, _blocks(random, n, [[[v]] for v in values]), int(random.integers(1, 2 * n)))
    return _first("cluster", A, easy=k <= 20, known=1 if centre > 0 else -1)


FAMILIES: tuple[Maker, ...] = (
    near_marginal, wild_units, jordan, companion, non_normal, time_constants, dense_random, light_damping, rigid_body,
    gyroscopic, follower, thin_mass, mixed_second, slow_cluster,
)  # fmt: skip
