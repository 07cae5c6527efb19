"""Spectral radii of many small matrices without their eigenvalues, by scaled repeated squaring.

P_k = M^(2^k) / 2^(e_k), with a power of two taken out after every squaring so that |P_k| (Frobenius) stays in [1/2, 1).

Moduli. After k squarings all but the two leading multipliers are negligible beside the first, and those two follow
from the traces: with e_1 = tr P and e_2 = (tr(P)^2 - tr(P^2)) / 2 they are the roots of x^2 - e_1 x + e_2. That no
third one hides is proved by R = P^3 - e_1 P^2 + e_2 P: every eigenvalue x of P has |x (x - x_1) (x - x_2)| <= |R|.
The 2^k-th root divides every relative error of x_1 by 2^k. Rounding: a product of n by n matrices of norm 1 errs by at
most g = n u in norm; made at level j it moves an eigenvalue x_j of P_j by c g, with c the size of the projector onto
its direction, so the modulus errs relatively by about the sum over j of c g / (2^j |x_j|). For c stands the largest
1/|x_j| so far (|P_j| is about 1; at one level alone the projectors of a pair may cancel). The j = 0 term,
c g |M| / rho, is what eigenvalue solvers lose too. A modulus is called sure when twice this sum and the truncation stay
below `ACCURACY`; that is a first-order estimate, not a proof.

Decisions. |M^N| < r^N proves rho < r, and |tr M^N| > n r^N proves rho > r. Here the rounding bound is a proof: with
|P_k - exact| <= E_k, E_(k+1) = (2 E_k |P_k| + E_k^2 + g |P_k|^2) / 2^shift, started with the rounding of the series.
It grows by up to 2 / |P_k^2| per squaring, so strongly non-normal matrices close to r stay undecided.

The array functions take their namespace `xp` (NumPy, or one that copies it); `device` runs them elsewhere.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray

ROUNDING: Final = 2.0**-52  # twice the unit roundoff: covers the error of the bounds' own arithmetic
TINY: Final = 1e-150  # squares of smaller entries underflow; added to every absolute bound
SLACK: Final = 1.0 + 1e-12  # for the rounding of norms and bounds, n^2 unit roundoffs at most
ACCURACY: Final = 2e-11  # estimated relative error below which a modulus is sure (the promise is 1e-10)
CHECKS: Final = (4, 6, 8, 10, 12, 14, 17, 20)  # squarings after which the moduli are tried
LAST_SQUARING: Final = 40  # 2^40 periods: closer to the threshold than 1e-11 nothing is decided
SAFETY: Final = 2.0  # on the first-order rounding estimate of a modulus
_CHUNK_ENTRIES = 1 << 16  # matrix entries worked on at once: half a mebibyte per array


class RadiusEngine(Protocol):
    """Leading multipliers, spectral radii and stability of M_i = sum_k basis[i, k] coefficients[k].

    `coefficients` (m, n, n), `basis` (q, m), both real.
    """

    name: str

    def multipliers(self, coefficients: FloatArray, basis: FloatArray) -> ComplexArray:
        """Eigenvalue of largest modulus of each matrix, imaginary part >= 0; (q,), NaN where a matrix is not finite."""

    def moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Spectral radii (q,), and which of them are sure to 1e-10 relative; the others come from eigenvalues."""

    def decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        """-1 where the radius is proved < stable_below, 1 where proved > unstable_above, else 0; (q,)."""


class Powers(NamedTuple):
    """`matrix` (q, n, n) with `norm` in [1/2, 1); times 2^`exponent` (q,) it is M^(2^squarings) within `error`."""

    matrix: Any
    exponent: Any
    norm: Any
    error: Any
    squarings: int


def first_power(xp: Any, matrices: Any, error: Any) -> Powers:
    """The matrices scaled by powers of two, exactly; `error` (q,) bounds their error in Frobenius norm."""
    largest = xp.max(xp.abs(matrices), axis=(-2, -1))
    _, shift = xp.frexp(largest)
    shift = xp.where(xp.isfinite(largest) & (largest > 0.0), shift, 0)
    scaled = xp.ldexp(matrices, -shift[:, None, None])
    powers = Powers(scaled, 1.0 * shift, _norm(xp, scaled), xp.ldexp(error, -shift), 0)
    return _normalised(xp, powers)


def next_power(xp: Any, powers: Powers, square: Any = None) -> Powers:
    """One squaring further; `square` (q, n, n) is matrix @ matrix where it is known already, and is used up."""
    matrix, exponent, norm, error, squarings = powers
    square = matrix @ matrix if square is None else square
    rounding = matrix.shape[-1] * ROUNDING
    error = (error * (2.0 * norm + error) + rounding * norm * norm + TINY) * SLACK
    return _normalised(xp, Powers(square, 2.0 * exponent, _norm(xp, square), error, squarings + 1))


def judged(xp: Any, powers: Powers, stable_below: float, unstable_above: float) -> Any:
    """-1, 1 or 0 (q,): what norm and trace of this power prove."""
    matrix, exponent, norm, error, squarings = powers
    n, count = matrix.shape[-1], 2.0**squarings
    bound = xp.log2((norm + error) * SLACK)
    trace = xp.abs(xp.trace(matrix, axis1=-2, axis2=-1)) - n * (error + n * ROUNDING * norm)
    least = xp.log2(xp.maximum(trace, 0.0) / (n * SLACK))
    result = xp.zeros(norm.shape, dtype=xp.int8)
    if unstable_above < np.inf:
        level = count * _log2(unstable_above)
        proved = least + exponent > level + _allowance(xp, least, exponent, level)
        result = xp.where(proved, xp.int8(1), result)
    if stable_below > 0.0:
        level = count * _log2(stable_below)
        proved = bound + exponent < level - _allowance(xp, bound, exponent, level)
        result = xp.where(proved, xp.int8(-1), result)
    return result


def leading_pair(xp: Any, powers: Powers, square: Any) -> tuple[Any, Any, Any, Any, Any]:
    """e_1, e_2, the squared root distance, the larger modulus (q,), and whether the traces leave room for no third."""
    matrix = powers.matrix
    first = xp.trace(matrix, axis1=-2, axis2=-1)
    second = xp.trace(square, axis1=-2, axis2=-1)
    third = xp.einsum("qij,qji->q", square, matrix)
    product = 0.5 * (first * first - second)
    distance = 2.0 * second - first * first
    real = 0.5 * (xp.abs(first) + xp.sqrt(xp.maximum(distance, 0.0)))
    largest = xp.where(distance >= 0.0, real, xp.sqrt(xp.maximum(product, 0.0)))
    rest = xp.abs(third - first**3 + 3.0 * first * product)
    plausible = rest <= ACCURACY * 2.0**powers.squarings * largest**3
    return first, product, distance, largest, plausible & (largest > 0.0)


def verified_modulus(
    xp: Any, powers: Powers, square: Any, history: Any, pair: tuple[Any, Any, Any, Any, Any]
) -> tuple[Any, Any]:
    """Spectral radius (q,) from the leading pair, and its estimated relative error (q,).

    `history` (k + 1, q): the exponents e_0 ... e_k of this and the earlier powers; further rows may be -inf.
    """
    matrix, exponent, _, _, squarings = powers
    first, product, distance, largest, _ = pair
    n, count = matrix.shape[-1], 2.0**squarings
    rest = square @ matrix - first[:, None, None] * square + product[:, None, None] * matrix
    logarithm = exponent / count + xp.log2(largest) / count
    level = xp.arange(1.0 * len(history))[:, None]
    growth = xp.exp2(history - 2.0**level * logarithm)  # |M^(2^j)| / rho^(2^j), at most twice too large
    condition, loss = xp.max(growth, axis=0), xp.sum(growth / 2.0**level, axis=0)
    truncation = _norm(xp, rest) / largest**3
    rounding = SAFETY * n * ROUNDING * (1.0 / largest**2 + count * loss * condition)
    error = truncation + rounding
    apart = xp.maximum(xp.sqrt(xp.abs(distance)) / largest, xp.sqrt(error))
    # of a pair known to be complex the product alone counts; its error does not grow as the two meet
    complex_pair = distance < -4.0 * error * largest**2
    amplified = xp.where(complex_pair, n * truncation + rounding, 2.0 * error / apart)
    return xp.exp2(logarithm), xp.where(error < 1e-2, amplified / count, np.inf)


def series_rounding(coefficients: FloatArray, basis: FloatArray) -> FloatArray:
    """Bound (q,) in Frobenius norm on the rounding error of sum_k basis[:, k] coefficients[k]."""
    flat = np.abs(coefficients.reshape(len(coefficients), -1))
    largest = np.max(flat, axis=1, initial=0.0)  # taken out, because its square may overflow
    terms = largest * np.sqrt(np.sum((flat / np.where(largest > 0.0, largest, 1.0)[:, None]) ** 2, axis=1))
    return np.asarray((len(terms) + 1) * ROUNDING * (np.abs(basis) @ terms))


class NumpyRadius:
    """The engine in NumPy: batched products in chunks that fit the cache, solved matrices leave the chunk.

    Examples
    --------
    >>> engine = NumpyRadius()
    >>> coefficients = np.array([[[0.0, 1.0], [-1.0, 0.0]], [[0.5, 0.0], [0.0, 0.5]]])
    >>> basis = np.array([[1.0, 0.0], [0.6, 0.8]])
    >>> engine.moduli(coefficients, basis)[0].round(12).tolist()
    [1.0, 0.721110255093]
    >>> engine.decide(coefficients, basis, 0.99, 1.01).tolist()
    [0, -1]
    """

    name = "numpy"

    def multipliers(self, coefficients: FloatArray, basis: FloatArray) -> ComplexArray:
        """Eigenvalue of largest modulus of each matrix, imaginary part >= 0; (q,), NaN where a matrix is not finite."""
        coefficients, basis = checked(coefficients, basis)
        result = np.empty(len(basis), dtype=np.complex128)
        for part in chunks(len(basis), coefficients.shape[-1]):
            result[part] = leading_eigenvalues(evaluated(coefficients, basis[part]))
        return result

    def moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Spectral radii (q,), and which of them are sure to 1e-10 relative; the others come from eigenvalues."""
        coefficients, basis = checked(coefficients, basis)
        modulus, sure = self._moduli(coefficients, basis)
        return completed(modulus, sure, coefficients, basis)

    def decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        """-1 where the radius is proved < stable_below, 1 where proved > unstable_above, else 0; (q,).

        Raises
        ------
        ValueError : stable_below > unstable_above, or shapes that do not fit
        """
        coefficients, basis = checked(coefficients, basis)
        check_levels(stable_below, unstable_above)
        return self._decide(coefficients, basis, stable_below, unstable_above)

    def _moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Spectral radii without eigenvalues, and which are sure, of checked arrays; other engines replace this."""
        modulus, sure = np.empty(len(basis)), np.zeros(len(basis), dtype=np.bool_)
        for part in chunks(len(basis), coefficients.shape[-1]):
            matrices = evaluated(coefficients, basis[part])
            with np.errstate(all="ignore"):
                modulus[part], sure[part] = moduli_of(matrices)
        return modulus, sure

    def _decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        """The decisions for checked arrays and levels; other engines replace this."""
        result = np.zeros(len(basis), dtype=np.int8)
        with np.errstate(all="ignore"):
            rounding = series_rounding(coefficients, basis)
            for part in chunks(len(basis), coefficients.shape[-1]):
                matrices = evaluated(coefficients, basis[part])
                result[part] = decided(matrices, rounding[part], stable_below, unstable_above)
        return result


def moduli_of(matrices: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Spectral radii of a stack (q, n, n) that fits the cache, and which are sure; NaN where not sure."""
    modulus = np.full(len(matrices), np.nan)
    zero = ~np.any(matrices, axis=(1, 2))
    modulus[zero] = 0.0
    active = np.nonzero(~zero)[0]
    powers = first_power(np, matrices[active], np.zeros(len(active)))
    history = [powers.exponent]
    while len(active) and powers.squarings <= CHECKS[-1]:
        square = powers.matrix @ powers.matrix
        if powers.squarings in CHECKS:
            pair = leading_pair(np, powers, square)
            tried = np.nonzero(pair[-1])[0]
            value, error = verified_modulus(
                np, _taken(powers, tried), square[tried], np.array(history)[:, tried],
                (pair[0][tried], pair[1][tried], pair[2][tried], pair[3][tried], pair[4][tried]),
            )  # fmt: skip
            good = error <= ACCURACY
            modulus[active[tried[good]]] = value[good]
            keep = np.isfinite(powers.norm)
            keep[tried[good]] = False
            if not np.all(keep):
                left = np.nonzero(keep)[0]
                active, powers, square = active[left], _taken(powers, left), square[left]
                history = [exponent[left] for exponent in history]
        powers = next_power(np, powers, square)
        history.append(powers.exponent)
    return modulus, ~np.isnan(modulus)


def decided(matrices: FloatArray, rounding: FloatArray, stable_below: float, unstable_above: float) -> NDArray[np.int8]:
    """Decisions (q,) for a stack (q, n, n) known within `rounding` (q,); decided and hopeless ones leave the stack."""
    result = np.zeros(len(matrices), dtype=np.int8)
    active = np.arange(len(matrices))
    powers = first_power(np, matrices, rounding)
    while len(active):
        found = judged(np, powers, stable_below, unstable_above)
        result[active] = found
        # with an error bound above the norm itself neither test can succeed any more
        left = np.nonzero((found == 0) & (powers.error < 1.0))[0]
        if powers.squarings == LAST_SQUARING:
            break
        if len(left) < len(active):
            active, powers = active[left], _taken(powers, left)
        powers = next_power(np, powers)
    return result


def leading_eigenvalues(matrices: FloatArray) -> ComplexArray:
    """Eigenvalue of largest modulus, imaginary part >= 0, of each matrix of a stack; (q,), NaN if not finite."""
    result = np.full(len(matrices), np.nan + 0j, dtype=np.complex128)
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    if np.any(finite):
        values = np.linalg.eigvals(matrices if np.all(finite) else matrices[finite])
        best = np.argmax(np.abs(values), axis=1)
        leading = values[np.arange(len(values)), best]
        result[finite] = np.where(leading.imag < 0.0, leading.conj(), leading)
    return result


def completed(
    modulus: FloatArray, sure: NDArray[np.bool_], coefficients: FloatArray, basis: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The moduli with those that are not sure computed from eigenvalues."""
    unsure = np.nonzero(~sure)[0]
    for part in chunks(len(unsure), coefficients.shape[-1]):
        modulus[unsure[part]] = np.abs(leading_eigenvalues(evaluated(coefficients, basis[unsure[part]])))
    return modulus, sure


def evaluated(coefficients: FloatArray, basis: FloatArray) -> FloatArray:
    """sum_k basis[i, k] coefficients[k]: (q, n, n)."""
    with np.errstate(over="ignore", invalid="ignore"):
        values = basis @ coefficients.reshape(len(coefficients), -1)
    return np.asarray(values.reshape(len(basis), *coefficients.shape[1:]))


def checked(coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Both as contiguous float64.

    Raises
    ------
    ValueError : shapes that do not fit
    """
    coefficients = np.ascontiguousarray(coefficients, dtype=np.float64)
    basis = np.ascontiguousarray(basis, dtype=np.float64)
    if coefficients.ndim != 3 or coefficients.shape[1] != coefficients.shape[2] or not coefficients.shape[1]:
        raise ValueError(f"coefficients: expected shape (m, n, n) with n >= 1, got {coefficients.shape}")
    if basis.ndim != 2 or basis.shape[1] != len(coefficients):
        raise ValueError(f"basis: expected shape (q, {len(coefficients)}), got {basis.shape}")
    return coefficients, basis


def check_levels(stable_below: float, unstable_above: float) -> None:
    """Refuse levels out of order.

    Raises
    ------
    ValueError : stable_below > unstable_above, or one of them NaN
    """
    if not stable_below <= unstable_above:
        raise ValueError(f"stable_below: expected at most unstable_above = {unstable_above:g}, got {stable_below:g}")


def chunks(count: int, n: int) -> list[slice]:
    """Slices of `count` matrices n by n, each small enough for the cache."""
    step = max(16, _CHUNK_ENTRIES // (n * n))
    return [slice(first, min(first + step, count)) for first in range(0, count, step)]


def _norm(xp: Any, matrices: Any) -> Any:
    """Frobenius norms (q,)."""
    return xp.sqrt(xp.einsum("qij,qij->q", matrices, matrices))


def _normalised(xp: Any, powers: Powers) -> Powers:
    """A power of two taken out, so that the norm is in [1/2, 1); nothing where it is zero or not finite."""
    matrix, exponent, norm, error, squarings = powers
    _, shift = xp.frexp(norm)
    shift = xp.where(xp.isfinite(norm) & (norm > TINY), shift, 0)
    scale = xp.ldexp(xp.ones_like(norm), -shift)
    matrix *= scale[:, None, None]  # in place where the namespace allows it
    return Powers(matrix, exponent + shift, norm * scale, error * scale, squarings)


def _taken(powers: Powers, rows: NDArray[np.intp]) -> Powers:
    """The powers of some matrices only."""
    if len(rows) == len(powers.norm):
        return powers
    matrix, exponent, norm, error, squarings = powers
    return Powers(matrix[rows], exponent[rows], norm[rows], error[rows], squarings)


def _log2(level: float) -> float:
    """log2 of a level, minus infinity at and below zero."""
    return float(np.log2(level)) if level > 0.0 else -np.inf


def _allowance(xp: Any, logarithm: Any, exponent: Any, level: float) -> Any:
    """What the rounding of two logarithms and their sum may amount to."""
    return 4.0 * ROUNDING * (xp.abs(logarithm) + xp.abs(exponent) + abs(level) + 1.0)
