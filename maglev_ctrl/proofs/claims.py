"""What a certificate claims about closed loops: statements with the matrices that prove them.

`plants` and `controllers` of a claim are indices into the design's plants and laws, pair by pair: closed loop i joins
plant `plants[i]` with controller `controllers[i]`. A certificate matrix has as many rows as the closed loop has states
(the plant's, then the controller's); a stack (1, n, n) is one matrix for all loops, (k, n, n) one for each.
"""

from __future__ import annotations

from dataclasses import dataclass

from maglev_ctrl.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class DecayClaim:
    """All poles decay at `rate` (1/s) or faster: A'P + P A + 2 rate P < 0; sampled: A'P A < exp(-2 rate dt) P.

    With one P for several loops the claim covers every loop between them, however fast it varies (quadratic
    stability). Where the closed loop is no affine function of the weights (plant inputs vary, and outputs or laws
    too), that needs the loops of plant i with law j. They are checked for a common law, and for several laws if
    `cross` is set; if it is not, the claim is about the given loops alone, and its proof's statement says so.
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    rate: float
    P: FloatArray
    cross: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class RegionClaim:
    """All poles lie where L + s M + conj(s) M' < 0: L (x) X + M (x) (A X) + M' (x) (A X)' < 0 with X > 0.

    L (r, r) symmetric, M (r, r): half plane, disk, sector, strip and their intersections (Chilali & Gahinet 1996).
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    region: str
    L: FloatArray
    M: FloatArray
    X: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class GainClaim:
    """Peak gain (H-infinity norm) from `disturbances` to `performance` below `gamma`: the bounded-real inequality.

        [[A'P + P A, P B, C'], [B'P, -gamma I, D'], [C, D, -gamma I]] < 0, P > 0
        sampled: [[A'P A - P, A'P B, C'], [B'P A, B'P B - gamma I, D'], [C, D, -gamma I]] < 0

    Empty tuples of names mean all.
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    gamma: float
    P: FloatArray
    disturbances: tuple[str, ...] = ()
    performance: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class EnergyClaim:
    """H2 norm from `disturbances` to `performance` below `level`: A'P + P A + C'C < 0, trace B'P B < level^2, D = 0.

    Sampled: A'P A - P + C'C < 0, trace(B'P B + D'D) < level^2.
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    level: float
    P: FloatArray
    disturbances: tuple[str, ...] = ()
    performance: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class EllipsoidClaim:
    """From any state with x'P x <= 1 the loop stays there and command j stays below `limits[j]`, without disturbance.

    A'P + P A < 0 (sampled A'P A < P) and u_j' u_j < limits[j]^2 P for the rows u_j of the command, that is
    [[limits[j]^2, u_j], [u_j', P]] > 0, strictly; a P that just touches a limit is not accepted.
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    P: FloatArray
    limits: tuple[float, ...]


@dataclass(frozen=True, eq=False, slots=True)
class ParameterClaim:
    """Every constant blend of the loops decays at `rate`, proved by P = sum of weights x P_i and a slack matrix V.

        [[-(V + V'), V' a_i + P_i, V'], [., -P_i, 0], [., ., -P_i]] < 0 for all i, a_i = time (A_i + rate I)

    (Apkarian, Tuan & Bernussou, IEEE TAC 46 (2001) 1941, continuous); P (k, n, n), V (n, n). `time` (s) is the unit of
    time, which such a V depends on: about the time constant of the loops. The inequality is affine
    in A_i and P_i together, so that it passes to every blend; with W = V^-1, Y = P^-1 and a = a_i its Schur
    complement is (W + Y(a' - I))'P(W + Y(a' - I)) + a Y + Y a' < 0, hence a'P + P a < 0. Refused where the closed loop
    is no affine function of the weights (laws that differ while plant inputs or outputs do).
    """

    plants: tuple[int, ...]
    controllers: tuple[int, ...]
    rate: float
    P: FloatArray
    V: FloatArray
    time: float = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class SegmentClaim:
    """Between loops i and i+1, blended linearly over a parameter, the loop is stable while the parameter moves slowly.

    P runs linearly from P[0] to P[1] over `width` of the parameter; |rate of the parameter| <= `speed_limit`:
    A(l)'P(l) + P(l) A(l) +- speed_limit (P1 - P0) / width < 0 for all l in [0, 1], by Bernstein coefficients in l.
    Two loops: `plants` and `controllers` hold two indices each. Plants and laws are blended matrix by matrix; where
    plant inputs (or outputs) and laws both vary, A(l) is quadratic in l with the cross products, and the polynomial is
    of degree three (four where all three vary). The degree is found from the matrices, whatever `cross` says.
    """

    plants: tuple[int, int]
    controllers: tuple[int, int]
    P: FloatArray
    width: float
    speed_limit: float
    cross: bool = False


Claim = DecayClaim | RegionClaim | GainClaim | EnergyClaim | EllipsoidClaim | ParameterClaim | SegmentClaim


@dataclass(frozen=True, eq=False, slots=True)
class Proof:
    """Outcome of re-checking one claim.

    `holds` only where rigorous arithmetic says so; `margin` smallest eigenvalue of the (scaled) inequality, negative
    where violated; `method` "rounding bounds" or "rational arithmetic"; `statement` the claim in a sentence; `reason`
    why it does not hold.
    """

    statement: str
    holds: bool
    margin: float
    method: str
    reason: str = ""
