"""Every kind of claim: proved where closed forms say it holds, and not proved a little beyond."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from maglev_ctrl.proofs.claims import (
    Claim,
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.proofs.makers import bounded_real_claim, energy_claim, lyapunov_claim
from maglev_ctrl.proofs.prove import RATIONAL, ROUNDED, prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel


def plant_of(A: object, B1: object = None, B2: object = None, C1: object = None, **more: object) -> Plant:
    a = np.atleast_2d(np.asarray(A, dtype=float))
    n = len(a)
    b1, b2, c1 = (
        np.eye(n)[:, :1] if B1 is None else B1,
        np.eye(n)[:, -1:] if B2 is None else B2,
        np.eye(n)[:1] if C1 is None else C1,
    )
    return Plant.from_matrices(a, b1, b2, c1, **more)  # type: ignore[arg-type]


def law_for(plant: Plant, gain: object = None) -> Controller:
    shape = (len(plant.commands), len(plant.measured))
    matrix = np.zeros(shape) if gain is None else gain
    return Controller.static(matrix, measured=plant.measured, commands=plant.commands, dt=plant.dt)  # type: ignore[arg-type]


def lyapunov(A: np.ndarray, Q: np.ndarray | None = None) -> np.ndarray:
    P = scipy.linalg.solve_continuous_lyapunov(A.T, -(np.eye(len(A)) if Q is None else Q))
    return 0.5 * (P + P.T)


def proof_of(claim: Claim, *plants: Plant, laws: list[Controller] | None = None):  # type: ignore[no-untyped-def]
    return prove(claim, plants, laws if laws is not None else [law_for(plants[0])])


class TestDecay:
    A = np.array([[0.0, 1.0], [-4.0, -0.6]])  # poles at -0.3 +- 1.98i

    def test_rate_up_to_the_abscissa(self) -> None:
        plant = plant_of(self.A)
        for rate, holds in ((0.0, True), (0.29, True), (0.2999999, True)):
            P = lyapunov(self.A + rate * np.eye(2))
            assert proof_of(DecayClaim((0,), (0,), rate, P[None]), plant).holds is holds
            assert not proof_of(DecayClaim((0,), (0,), 0.3000001, P[None]), plant).holds

    def test_mutants(self) -> None:
        plant, P = plant_of(self.A), lyapunov(self.A)
        claim = DecayClaim((0,), (0,), 0.0, P[None])
        assert proof_of(claim, plant).holds
        flipped = self.A.copy()
        flipped[1, 1] *= -1.0
        assert not proof_of(claim, plant_of(flipped)).holds
        assert not proof_of(replace(claim, P=-P[None]), plant).holds
        assert not proof_of(replace(claim, P=np.zeros((1, 2, 2))), plant).holds
        assert not proof_of(replace(claim, P=np.diag([1.0, 0.0])[None]), plant).holds

    def test_marginal_loop_is_never_proved(self) -> None:
        plant = plant_of([[0.0, 1.0], [-1.0, 0.0]])
        rng = np.random.default_rng(0)
        for _ in range(50):
            X = rng.standard_normal((2, 2))
            for P in (np.eye(2), X @ X.T + 0.1 * np.eye(2)):
                proof = proof_of(DecayClaim((0,), (0,), 0.0, (0.5 * (P + P.T))[None]), plant)
                assert not proof.holds
        assert proof.reason

    def test_what_rounding_hides_is_decided_exactly(self) -> None:
        plant = plant_of([[0.0, 1.0], [-1.0, 0.0]])
        law = law_for(plant, [[0.0, -1e-300]])
        P = np.array([[1.0, 1e-301], [1e-301, 1.0]])
        proof = proof_of(DecayClaim((0,), (0,), 0.0, P[None]), plant, laws=[law])
        assert proof.holds and proof.method == RATIONAL
        assert not proof_of(DecayClaim((0,), (0,), 0.0, P[None]), plant, laws=[law_for(plant, [[0.0, 1e-300]])]).holds
        # one unit in the last place beside the exact limit -(A'P + P A) = 2 rate P, P = 1
        for rate, holds in ((1.0, False), (np.nextafter(1.0, 0.0), True)):
            one = proof_of(DecayClaim((0,), (0,), rate, np.ones((1, 1, 1))), plant_of([[-1.0]]))
            assert one.holds is holds and one.method == RATIONAL

    def test_rational_arithmetic_catches_what_floats_pass(self) -> None:
        """0.1 x 10 rounds to 1: the loop 0.1 x 10 - 1 has the pole 2^-54, not 0."""
        plant = Plant.from_matrices([[-1.0]], [[1.0]], [[10.0]], [[1.0]])
        assert closed_channel(plant, law_for(plant, [[0.1]]))[0][0, 0] == 0.0
        claim = DecayClaim((0,), (0,), 0.0, np.ones((1, 1, 1)))
        assert not proof_of(claim, plant, laws=[law_for(plant, [[0.1]])]).holds
        below = [law_for(plant, [[np.nextafter(0.1, 0.0)]])]
        assert proof_of(claim, plant, laws=below).holds

    def test_unsymmetric_matrix_means_its_symmetric_part(self) -> None:
        plant, P = plant_of(self.A), lyapunov(self.A)
        skewed = P + np.array([[0.0, 0.3], [-0.3, 0.0]])
        assert proof_of(DecayClaim((0,), (0,), 0.0, skewed[None]), plant).holds

    def test_sampled(self) -> None:
        plant = plant_of([[0.9]], dt=0.1)
        limit = -np.log(0.9) / 0.1
        one = np.ones((1, 1, 1))
        assert proof_of(DecayClaim((0,), (0,), 0.9999999 * limit, one), plant).holds
        assert not proof_of(DecayClaim((0,), (0,), 1.0000001 * limit, one), plant).holds
        assert not proof_of(DecayClaim((0,), (0,), 0.0, one), plant_of([[1.0]], dt=0.1)).holds
        assert not proof_of(DecayClaim((0,), (0,), 0.0, one), plant_of([[-1.01]], dt=0.1)).holds

    def test_statement(self) -> None:
        claim = DecayClaim((0,), (0,), 0.25, lyapunov(self.A)[None])
        assert (
            proof_of(claim, plant_of(self.A)).statement == "every pole of the closed loop decays at 0.25 1/s or faster"
        )


class TestSeveralLoops:
    def test_common_matrix_covers_the_loops_between(self) -> None:
        plants = [plant_of([[-a]]) for a in (1.0, 2.0, 3.0)]
        claim = DecayClaim((0, 1, 2), (0, 0, 0), 0.5, np.ones((1, 1, 1)))
        proof = proof_of(claim, *plants)
        assert proof.holds
        assert proof.statement == (
            "each of the 3 closed loops, and every loop between them however fast it varies, "
            "decays at 0.5 1/s or faster"
        )
        assert not proof_of(replace(claim, rate=1.1), *plants).holds

    def test_matrices_of_their_own_say_nothing_of_the_loops_between(self) -> None:
        plants = [plant_of([[-1.0, 10.0], [0.0, -1.0]]), plant_of([[-1.0, 0.0], [10.0, -1.0]])]
        own = lyapunov_claim(plants, [law_for(plants[0])])
        proof = proof_of(own, *plants)
        assert proof.holds and "between" not in proof.statement  # the loop halfway has a pole at +4
        for P in (*own.P, own.P.sum(axis=0)):
            assert not proof_of(DecayClaim((0, 1), (0, 0), 0.0, P[None]), *plants).holds

    def test_products_between_plants_are_checked(self) -> None:
        """Both sides vary: B2 C2 is +-1 at the ends; halfway between (1, 1) and (-1, -1) it is zero."""
        ends = [Plant.from_matrices([[0.5]], [[1.0]], [[b]], [[1.0]], [[b]], measured=("y",)) for b in (1.0, -1.0)]
        law = law_for(ends[0], [[-1.0]])
        claim = DecayClaim((0, 1), (0, 0), 0.0, np.ones((1, 1, 1)))
        assert all(prove(DecayClaim((i,), (0,), 0.0, claim.P), ends, [law]).holds for i in (0, 1))
        assert not prove(claim, ends, [law]).holds
        near = [Plant.from_matrices([[0.5]], [[1.0]], [[b]], [[1.0]], [[b]], measured=("y",)) for b in (1.0, 1.2)]
        assert prove(claim, near, [law]).holds

    def test_cross_products_of_plants_and_laws(self) -> None:
        plants = [Plant.from_matrices([[0.1]], [[1.0]], [[b]], [[1.0]]) for b in (1.0, -1.0)]
        laws = [law_for(plants[0], [[-k]]) for k in (1.0, -1.0)]
        claim = DecayClaim((0, 1), (0, 1), 0.0, np.ones((1, 1, 1)))
        plain = prove(claim, plants, laws)
        assert plain.holds and "between" not in plain.statement
        assert not prove(replace(claim, cross=True), plants, laws).holds  # halfway the command does nothing
        plants = [Plant.from_matrices([[0.1]], [[1.0]], [[b]], [[1.0]]) for b in (1.0, 2.0)]
        crossed = prove(replace(claim, cross=True), plants, [laws[0], law_for(plants[0], [[-0.5]])])
        assert crossed.holds and "between" in crossed.statement

    def test_blends_of_laws_on_one_input_need_no_products(self) -> None:
        plants = [plant_of([[a]]) for a in (0.5, 1.0)]
        laws = [law_for(plants[0], [[-k]]) for k in (1.0, 2.0)]
        proof = prove(DecayClaim((0, 1), (0, 1), 0.4, np.ones((1, 1, 1))), plants, laws)
        assert proof.holds and "between" in proof.statement

    def test_direct_feedthrough_is_no_polynomial(self) -> None:
        ends = [
            Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], D22=[[d]], measured=("y",))
            for d in (0.1, 0.2)
        ]
        law = law_for(ends[0], [[-1.0]])
        assert prove(DecayClaim((0, 1), (0, 0), 0.0, np.ones((2, 1, 1))), ends, [law]).holds
        proof = prove(DecayClaim((0, 1), (0, 0), 0.0, np.ones((1, 1, 1))), ends, [law])
        assert not proof.holds and "D22" in proof.reason


class TestAlgebraicLoop:
    def plant(self, d: float) -> Plant:
        return Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], D22=[[d]], D21=[[0.5]], measured=("y",))

    def test_closed_loop_with_feedthrough(self) -> None:
        """u = -k y, y = x + d u: the pole is 1 - k / (1 + k d) = 1 - 3 / 1.3."""
        plant, one = self.plant(0.1), np.ones((1, 1, 1))
        laws = [law_for(plant, [[-3.0]])]
        limit = 3.0 / 1.3 - 1.0
        assert prove(DecayClaim((0,), (0,), limit * (1 - 1e-9), one), [plant], laws).holds
        assert not prove(DecayClaim((0,), (0,), limit * (1 + 1e-9), one), [plant], laws).holds

    def test_singular(self) -> None:
        plant = self.plant(0.25)
        proof = prove(DecayClaim((0,), (0,), 0.0, np.ones((1, 1, 1))), [plant], [law_for(plant, [[4.0]])])
        assert not proof.holds and "singular" in proof.reason


class TestRegion:
    """Disk |s + 4| < 3: L = [[-3, 4], [4, -3]], M = [[0, 1], [0, 0]]; sector of half angle 45 degrees."""

    disk = (np.array([[-3.0, 4.0], [4.0, -3.0]]), np.array([[0.0, 1.0], [0.0, 0.0]]))
    sector = (np.zeros((2, 2)), np.array([[1.0, 1.0], [-1.0, 1.0]]))

    @pytest.mark.parametrize(("pole", "inside"), [(-1.001, True), (-0.999, False), (-6.999, True), (-7.001, False)])
    def test_disk(self, pole: float, inside: bool) -> None:
        claim = RegionClaim((0,), (0,), "disk", *self.disk, np.ones((1, 1, 1)))
        assert proof_of(claim, plant_of([[pole]])).holds is inside

    @pytest.mark.parametrize(("imaginary", "inside"), [(0.999, True), (1.001, False), (-0.999, True), (-1.001, False)])
    def test_sector(self, imaginary: float, inside: bool) -> None:
        A = np.array([[-1.0, imaginary], [-imaginary, -1.0]])
        claim = RegionClaim((0,), (0,), "sector", *self.sector, np.eye(2)[None])
        assert proof_of(claim, plant_of(A)).holds is inside

    def test_mutants(self) -> None:
        claim = RegionClaim((0,), (0,), "disk", *self.disk, np.ones((1, 1, 1)))
        assert proof_of(claim, plant_of([[-4.0]])).holds
        assert not proof_of(replace(claim, X=-claim.X), plant_of([[-4.0]])).holds
        assert not proof_of(replace(claim, L=-claim.L), plant_of([[-4.0]])).holds
        assert not proof_of(replace(claim, L=np.array([[-3.0, 4.0], [3.0, -3.0]])), plant_of([[-4.0]])).holds


def oscillator(dt: float | None = None) -> Plant:
    """Peak gain 1 / (2 z sqrt(1 - z^2)), z = 0.1, of 1 / (s^2 + 0.2 s + 1); H2 norm sqrt(1 / (4 z)) = sqrt 2.5."""
    A = [[0.0, 1.0], [-1.0, -0.2]] if dt is None else [[0.5]]
    if dt is not None:
        return Plant.from_matrices(A, [[1.0]], [[1.0]], [[1.0]], dt=dt)
    return Plant.from_matrices(A, [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]])


PEAK = 1.0 / (0.2 * np.sqrt(0.99))


class TestGain:
    @pytest.mark.parametrize("slack", [1e-2, 1e-4, 1e-6])
    def test_just_above_the_norm(self, slack: float) -> None:
        plant = oscillator()
        claim = bounded_real_claim(plant, law_for(plant), PEAK * (1 + slack))
        assert proof_of(claim, plant).holds
        assert not proof_of(replace(claim, gamma=PEAK * 0.999), plant).holds

    def test_mutants(self) -> None:
        plant = oscillator()
        claim = bounded_real_claim(plant, law_for(plant), PEAK * 1.001)
        swapped = replace(plant, C1=np.array([[0.0, 3.0]]))
        assert not proof_of(claim, swapped).holds
        assert not proof_of(claim, replace(plant, A=np.array([[0.0, 1.0], [-1.0, 0.2]]))).holds
        assert not proof_of(claim, replace(plant, D11=np.array([[1.0]]))).holds
        assert not proof_of(replace(claim, P=1.01 * claim.P), plant).holds

    def test_sampled(self) -> None:
        """1 / (z - 0.5) peaks at z = 1 with 2."""
        plant = oscillator(dt=0.1)
        claim = bounded_real_claim(plant, law_for(plant), 2.0001)
        assert proof_of(claim, plant).holds
        assert not proof_of(replace(claim, gamma=1.998), plant).holds

    def test_a_channel_of_several(self) -> None:
        """Two unlike channels side by side: gains 1 and 5, one of them claimed by name."""
        plant = plant_of(
            -np.eye(2), np.diag([1.0, 5.0]), None, np.eye(2), disturbances=("a", "b"), performance=("e", "f")
        )
        law = law_for(plant)
        claim = bounded_real_claim(plant, law, 1.001, disturbances=("a",), performance=("e",))
        proof = prove(claim, [plant], [law])
        assert proof.holds and proof.statement == "the peak gain of the closed loop from a to e is below 1.001"
        assert not prove(replace(claim, disturbances=(), performance=()), [plant], [law]).holds
        assert not prove(replace(claim, disturbances=("b",), performance=("f",)), [plant], [law]).holds
        unknown = prove(replace(claim, disturbances=("c",)), [plant], [law])
        assert not unknown.holds and "'c'" in unknown.reason


class TestEnergy:
    @pytest.mark.parametrize("slack", [1e-3, 1e-7])
    def test_just_above_the_norm(self, slack: float) -> None:
        plant, norm = oscillator(), np.sqrt(2.5)
        claim = energy_claim(plant, law_for(plant), norm * (1 + slack))
        assert proof_of(claim, plant).holds
        assert not proof_of(replace(claim, level=norm * 0.999), plant).holds
        assert not proof_of(claim, replace(plant, C1=np.array([[1.1, 0.0]]))).holds
        assert not proof_of(claim, replace(plant, B1=np.array([[0.0], [1.1]]))).holds

    def test_sampled_with_feedthrough(self) -> None:
        """1 + 1 / (z - 0.5): 1 + 1 / (1 - 0.25)."""
        plant = replace(oscillator(dt=0.1), D11=np.array([[1.0]]))
        norm = np.sqrt(1.0 + 1.0 / 0.75)
        claim = energy_claim(plant, law_for(plant), norm * (1 + 1e-6))
        assert proof_of(claim, plant).holds
        assert not proof_of(replace(claim, level=norm * 0.999), plant).holds
        assert not proof_of(claim, replace(plant, D11=np.array([[1.01]]))).holds

    def test_feedthrough_has_infinite_energy(self) -> None:
        plant = oscillator()
        claim = energy_claim(plant, law_for(plant), 2.0)
        proof = proof_of(claim, replace(plant, D11=np.array([[1e-30]])))
        assert not proof.holds and "infinite" in proof.reason

    def test_feedthrough_that_cancels_exactly(self) -> None:
        plant = Plant.from_matrices(
            [[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], D11=[[0.5]], D12=[[1.0]], D21=[[1.0]], measured=("y",)
        )
        law = law_for(plant, [[-0.5]])  # x' = -1.5 x + 0.5 w, z = 0.5 x
        claim = energy_claim(plant, law, 0.145)  # 0.25 / sqrt 3 = 0.1443
        proof = prove(claim, [plant], [law])
        assert proof.holds and proof.method == RATIONAL


class TestEllipsoid:
    def test_commands_stay_below_their_limits(self) -> None:
        """x' = -2 x under u = -3 x from x' = x + u; x^2 <= 1: |u| <= 3."""
        plant = plant_of([[1.0]])
        laws = [law_for(plant, [[-3.0]])]
        claim = EllipsoidClaim((0,), (0,), np.ones((1, 1, 1)), (3.001,))
        proof = prove(claim, [plant], laws)
        assert proof.holds and proof.method == ROUNDED
        assert not prove(replace(claim, limits=(3.0,)), [plant], laws).holds  # touches
        assert not prove(replace(claim, limits=(2.999,)), [plant], laws).holds
        assert not prove(replace(claim, P=0.99 * claim.P), [plant], laws).holds
        assert not prove(claim, [plant], [law_for(plant, [[-0.5]])]).holds
        assert not prove(replace(claim, limits=(3.1, 3.1)), [plant], laws).holds


class TestParameter:
    """Stiffness between 1 and 2. For one loop any V = (Y (I - a'))^-1, Y = P^-1 > 0 with a Y + Y a' < 0, will do."""

    plants = tuple(plant_of([[0.0, 1.0], [-k, -1.0]]) for k in (1.0, 2.0))

    def claim(self) -> ParameterClaim:
        moved = [plant.A + 0.1 * np.eye(2) for plant in self.plants]
        Y = [lyapunov(a.T) for a in moved]
        W = sum(y @ (np.eye(2) - a.T) for a, y in zip(moved, Y, strict=True)) / 2.0
        P = np.stack([np.linalg.inv(y) for y in Y])
        return ParameterClaim((0, 1), (0, 0), 0.1, 0.5 * (P + P.transpose(0, 2, 1)), np.linalg.inv(W))

    def test_holds_and_implies_the_lyapunov_inequality_between(self) -> None:
        claim = self.claim()
        proof = proof_of(claim, *self.plants)
        assert proof.holds and "every constant loop between" in proof.statement
        for share in np.linspace(0.0, 1.0, 21):
            A = (1 - share) * self.plants[0].A + share * self.plants[1].A
            P = (1 - share) * claim.P[0] + share * claim.P[1]
            assert np.linalg.eigvalsh(A.T @ P + P @ A + 0.2 * P)[-1] < 0.0

    def test_mutants(self) -> None:
        claim = self.claim()
        assert not proof_of(replace(claim, rate=0.6), *self.plants).holds
        assert not proof_of(replace(claim, V=-claim.V), *self.plants).holds
        assert not proof_of(replace(claim, V=claim.V.T @ np.array([[0.0, 1.0], [1.0, 0.0]])), *self.plants).holds
        assert not proof_of(replace(claim, P=claim.P[::-1]), *self.plants).holds
        assert not proof_of(claim, self.plants[0], plant_of([[0.0, 1.0], [-2.0, 1.0]])).holds

    def test_refused_where_the_loop_is_not_affine(self) -> None:
        claim = self.claim()
        laws = [law_for(self.plants[0], [[0.0, -k]]) for k in (0.0, 0.1)]
        varied = replace(self.plants[1], B2=np.array([[0.0], [2.0]]))
        two = replace(claim, controllers=(0, 1))
        proof = prove(two, [self.plants[0], varied], laws)
        assert not proof.holds and "no blends" in proof.reason


class TestSegment:
    def test_speed_limit_of_a_scalar_loop(self) -> None:
        """a from -1 to -2, P from 1 to 2: at the ends 2 a P + v < 0, hence v < 2 (rising)."""
        plants = [plant_of([[-1.0]]), plant_of([[-2.0]])]
        claim = SegmentClaim((0, 1), (0, 0), np.array([[[1.0]], [[2.0]]]), 1.0, 1.999)
        assert proof_of(claim, *plants).holds
        assert not proof_of(replace(claim, speed_limit=2.0), *plants).holds
        assert not proof_of(replace(claim, speed_limit=2.001), *plants).holds
        assert proof_of(replace(claim, width=2.0, speed_limit=3.99), *plants).holds
        assert not proof_of(replace(claim, width=2.0, speed_limit=4.01), *plants).holds
        assert not proof_of(replace(claim, P=-claim.P), *plants).holds
        assert not proof_of(claim, plants[0], plant_of([[2.0]])).holds

    def test_falling_parameter(self) -> None:
        plants = [plant_of([[-2.0]]), plant_of([[-1.0]])]
        claim = SegmentClaim((0, 1), (0, 0), np.array([[[2.0]], [[1.0]]]), 1.0, 1.999)
        assert proof_of(claim, *plants).holds
        assert not proof_of(replace(claim, speed_limit=2.001), *plants).holds

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_products_of_plants_and_laws(self, sign: float) -> None:
        """B2 from 1 to +-1 and K from -1 to -+1: the loop is stable at both ends, halfway only with equal signs."""
        plants = [Plant.from_matrices([[0.5]], [[1.0]], [[b]], [[1.0]]) for b in (1.0, sign)]
        laws = [law_for(plants[0], [[-k]]) for k in (1.0, sign)]
        claim = SegmentClaim((0, 1), (0, 1), np.ones((2, 1, 1)), 1.0, 0.1)
        assert prove(claim, plants, laws).holds is (sign > 0.0)

    def test_coefficients_bound_the_polynomial(self) -> None:
        """Random segments: where proved, the inequality holds on a fine grid; every degree occurs."""
        rng = np.random.default_rng(8)
        proved = 0
        for trial in range(60):
            n = 3
            ends = []
            for _ in range(2):
                A = rng.standard_normal((n, n)) * 0.3 - 1.2 * np.eye(n)
                ends.append((A, rng.standard_normal((n, 1)) * 0.5, rng.standard_normal((1, n)) * 0.5))
            vary = [trial % 2, trial // 2 % 2, trial // 4 % 2]
            plants = [
                Plant.from_matrices(
                    ends[i][0],
                    np.ones((n, 1)),
                    ends[i * vary[0]][1],
                    np.ones((1, n)),
                    ends[i * vary[1]][2],
                    measured=("y",),
                )
                for i in range(2)
            ]
            gains = (-0.6, -0.6 + vary[2] * 1.0)
            laws = [law_for(plants[0], [[k]]) for k in gains]
            P = np.stack([lyapunov(closed_channel(p, k)[0]) for p, k in zip(plants, laws, strict=True)])
            claim = SegmentClaim((0, 1), (0, 1), P, 2.0, 0.2)
            holds = prove(claim, plants, laws).holds
            proved += holds
            worst = -np.inf
            for share in np.linspace(0.0, 1.0, 41):
                A, b, c = (
                    (1 - share) * getattr(plants[0], k) + share * getattr(plants[1], k) for k in ("A", "B2", "C2")
                )
                loop = A + b @ np.atleast_2d((1 - share) * gains[0] + share * gains[1]) @ c
                middle = (1 - share) * P[0] + share * P[1]
                for speed in (-0.2, 0.2):
                    S = loop.T @ middle + middle @ loop + speed * (P[1] - P[0]) / 2.0
                    worst = max(worst, float(np.linalg.eigvalsh(S)[-1]))
            assert not (holds and worst >= 0.0)
        assert proved > 30


class TestMisfits:
    plant, one = plant_of([[-1.0]]), np.ones((1, 1, 1))

    def test_programmer_errors(self) -> None:
        for claim in (
            DecayClaim((1,), (0,), 0.0, self.one),
            DecayClaim((), (), 0.0, self.one),
            DecayClaim((0,), (0, 0), 0.0, self.one),
            DecayClaim((0,), (-1,), 0.0, self.one),
        ):
            with pytest.raises(ValueError, match="claim"):
                proof_of(claim, self.plant)

    def test_names_periods_sizes_and_numbers(self) -> None:
        good = DecayClaim((0,), (0,), 0.0, self.one)
        other = Controller.static([[0.0]], measured=("other",), commands=("u1",))
        slow = Controller.static([[0.0]], measured=("x1",), commands=("u1",), dt=0.1)
        for law, said in ((other, "other"), (slow, "sampling periods")):
            proof = prove(good, [self.plant], [law])
            assert not proof.holds and said in proof.reason
        for claim in (
            replace(good, P=np.eye(2)[None]),
            replace(good, P=np.ones((2, 1, 1))),
            replace(good, P=np.full((1, 1, 1), np.nan)),
            replace(good, rate=np.nan),
            GainClaim((0,), (0,), -3.0, self.one),
            EnergyClaim((0,), (0,), np.inf, self.one),
            EllipsoidClaim((0,), (0,), self.one, (-1.0,)),
        ):
            proof = proof_of(claim, self.plant)
            assert not proof.holds and proof.reason

    def test_continuous_claims_of_sampled_loops(self) -> None:
        plant = plant_of([[0.5]], dt=0.1)
        proof = proof_of(SegmentClaim((0, 0), (0, 0), np.ones((2, 1, 1)), 1.0, 0.0), plant)
        assert not proof.holds and "continuous" in proof.reason

    def test_a_loop_without_states(self) -> None:
        plant = Plant.from_matrices(
            np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((1, 0)), D11=[[2.0]], C2=np.zeros((1, 0))
        )
        claim = GainClaim((0,), (0,), 2.001, np.zeros((1, 0, 0)))
        assert proof_of(claim, plant).holds
        assert not proof_of(replace(claim, gamma=1.999), plant).holds
