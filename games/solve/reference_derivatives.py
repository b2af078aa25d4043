"""Derivatives of many cars' costs in their controls, from CasADi functions of a single step.

A car's cost is J(u) = sum_t c(x_{t+1}, u_t) with x_{t+1} = f(x_t, u_t). With the sensitivities
X_t = dx_t/du and the costates p_t of the states,

    (D1)  X_{t+1} = A_t X_t + B_t E_t,          A = df/dx, B = df/du, E_t picks u_t from u
    (D2)  p_t = c_x + A_t' p_{t+1},             dJ/du_t = c_u + B_t' p_{t+1}
    (D3)  d2J/du2 = sum_t Z_t' [c_zz + (p' f)_zz] Z_t,   Z_t = (X_t, E_t)

Each CasADi function covers one step and is evaluated for all steps of all cars at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from olne_bench.games.compiled.row_functions import row_functions
from olne_bench.games.model.dynamics import Dynamics

#: Cost of one step as a CasADi expression of (state, control, near points, reference, weights).
StepCost = Callable[[ca.SX, ca.SX, list[ca.SX], ca.SX, ca.SX], ca.SX]

NX, NU = 4, 2  # sizes of a car's state and control
NZ = NX + NU


@dataclass(frozen=True)
class Linearisation:
    """Motion and derivatives at one point of the iteration; N cars, S steps, P partners."""

    states: np.ndarray  # (N, S, 4) after each step
    sensitivities: np.ndarray  # (N, S, 4, 2S) of these states to the car's controls
    gradients: np.ndarray  # (N, 2S) of a car's cost in its controls
    own_hessians: np.ndarray  # (N, 2S, 2S) of a car's cost in its controls
    #: (N, S, 4, 2P), second derivatives of a car's cost in its own state and the positions of its
    #: partners.
    cross: np.ndarray

    def take(self, cars: np.ndarray) -> "Linearisation":
        """The entries of some cars, by index."""
        return Linearisation(*(getattr(self, entry.name)[cars] for entry in fields(self)))

    def put(self, cars: np.ndarray, source: "Linearisation") -> None:
        """Replace the entries of some cars, by index."""
        for entry in fields(self):
            getattr(self, entry.name)[cars] = getattr(source, entry.name)


class CarDerivatives:
    """Derivatives of many cars' motion and costs; P partners of known motion, M other points."""

    def __init__(
        self,
        dynamics: Dynamics,
        step_cost: StepCost,
        *,
        num_weights: int,
        dt: float,
        steps: int,
        num_partners: int,
        num_others: int,
    ) -> None:
        self.steps = steps
        self.num_partners = num_partners
        state, control = ca.SX.sym("x", NX), ca.SX.sym("u", NU)
        following = dynamics.step(state, control, dt)
        options = {"cse": True}
        step = ca.Function("step", [state, control], [following], options)
        both = ca.vertcat(state, control)
        jacobian = ca.vec(ca.densify(ca.jacobian(following, both)))
        jacobians = ca.Function("jacobian", [state, control], [jacobian], options)
        costate = ca.SX.sym("p", NX)
        curvature = ca.hessian(ca.dot(costate, following), both)[0]
        curvatures = ca.Function(
            "curvature", [state, control, costate], [ca.vec(ca.densify(curvature))], options
        )
        weights, reference = ca.SX.sym("theta", num_weights), ca.SX.sym("reference", 4)
        partners = ca.SX.sym("partners", 2 * num_partners)
        others = ca.SX.sym("others", 2 * num_others)
        near = ca.vertsplit(partners, 2) + ca.vertsplit(others, 2)
        cost = step_cost(state, control, near, reference, weights)
        gradient = ca.densify(ca.gradient(cost, both))
        blocks = [
            gradient,
            ca.vec(ca.densify(ca.jacobian(gradient, both))),
            ca.vec(ca.densify(ca.jacobian(gradient[:NX], partners))),
        ]
        arguments = [state, control, weights, reference, partners, others]
        costs = ca.Function("cost", arguments, [ca.vertcat(*blocks)], options)
        motion = step.mapaccum("motion", steps)
        self._motion, self._jacobian, self._curvature, self._cost = row_functions(
            [motion, jacobians, curvatures, costs]
        )

    def states(self, initial: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """States (N, S, 4) after each step of controls (N, S, 2) from initial states (N, 4)."""
        count = len(initial)
        return self._motion(initial, controls).reshape(count, self.steps, NX)

    def linearise(
        self,
        initial: np.ndarray,
        controls: np.ndarray,
        states: np.ndarray,
        weights: np.ndarray,
        references: np.ndarray,
        partners: np.ndarray,
        others: np.ndarray,
    ) -> Linearisation:
        """All derivatives at controls (N, S, 2) that lead to states (N, S, 4).

        Partners (N, P, S, 2) and others (N, M, S, 2) are positions; see ``Situation`` for the rest.
        """
        count, steps = len(initial), self.steps
        before = np.concatenate([initial[:, None], states[:, :-1]], axis=1).reshape(-1, NX)
        u = controls.reshape(-1, NU)
        shape = (count, steps)
        motion = self._jacobian(before, u).reshape(*shape, NZ, NX).swapaxes(2, 3)
        found = self._cost(
            states.reshape(-1, NX),
            u,
            np.repeat(weights, steps, axis=0),
            references.reshape(-1, 4),
            partners.swapaxes(1, 2).reshape(count * steps, -1),
            others.swapaxes(1, 2).reshape(count * steps, -1),
        ).reshape(*shape, -1)
        first, second = found[..., :NZ], found[..., NZ : NZ + NZ**2].reshape(*shape, NZ, NZ)
        cross = found[..., NZ + NZ**2 :].reshape(*shape, 2 * self.num_partners, NX)
        costates = _costates(first, motion)
        bend = self._curvature(before, u, costates.reshape(-1, NX)).reshape(*shape, NZ, NZ)
        sensitivities = _sensitivities(motion)
        gradients = first[..., NX:] + (costates[..., None, :] @ motion[..., NX:])[..., 0, :]
        return Linearisation(
            states=states,
            sensitivities=sensitivities,
            gradients=gradients.reshape(count, -1),
            own_hessians=_own_hessians(second, bend, sensitivities),
            cross=cross.swapaxes(2, 3),
        )


def _sensitivities(motion: np.ndarray) -> np.ndarray:
    """Sensitivities X (N, S, 4, 2S) of (D1) from Jacobians (N, S, 4, 6)."""
    count, steps = motion.shape[:2]
    found = np.zeros((count, steps, NX, NU * steps))
    for t in range(steps):
        now = NU * t
        if t:
            found[:, t, :, :now] = motion[:, t, :, :NX] @ found[:, t - 1, :, :now]
        found[:, t, :, now : now + NU] = motion[:, t, :, NX:]
    return found


def _costates(first: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Costates p (N, S, 4) of (D2), of the state after each step."""
    found = first[..., :NX].copy()
    for t in range(found.shape[1] - 2, -1, -1):
        found[:, t] += (found[:, t + 1, None] @ motion[:, t + 1, :, :NX])[:, 0]
    return found


def _own_hessians(second: np.ndarray, bend: np.ndarray, sensitivities: np.ndarray) -> np.ndarray:
    """Hessians (N, 2S, 2S) of (D3); a step's curvature is added to the cost of the step before."""
    count, steps = second.shape[:2]
    size = NU * steps
    along = second[..., :NX, :NX].copy()
    along[:, :-1] += bend[:, 1:, :NX, :NX]
    flat = sensitivities.reshape(count, -1, size)
    found = flat.swapaxes(1, 2) @ (along @ sensitivities).reshape(count, -1, size)
    mixed = np.zeros((count, steps, NX, 2 * NU))
    mixed[..., :NU] = second[..., :NX, NX:]
    mixed[:, :-1, :, NU:] = bend[:, 1:, :NX, NX:]
    towards = sensitivities.swapaxes(2, 3) @ mixed  # (N, S, 2S, 4): this control, the next one
    skewed = towards[..., :NU].swapaxes(1, 2).reshape(count, size, size).copy()
    skewed[..., NU:] += towards[:, :-1, :, NU:].swapaxes(1, 2).reshape(count, size, size - NU)
    found += skewed + skewed.swapaxes(1, 2)
    own = second[..., NX:, NX:] + bend[..., NX:, NX:]
    diagonal = found.reshape(count, steps, NU, steps, NU)
    each = np.arange(steps)
    diagonal[:, each, :, each] += own.swapaxes(0, 1)
    return np.asarray(found)
