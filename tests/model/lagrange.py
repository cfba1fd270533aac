"""Equations of motion from energies, by SymPy: an oracle that shares nothing with the package but the physics."""

from collections.abc import Callable, Sequence

import numpy as np
import sympy as sp

t = sp.Symbol("t")


def coordinates(names: str) -> list[sp.Expr]:
    """Functions of time, one per name."""
    return [sp.Function(name)(t) for name in names.split()]


def euler_lagrange(lagrangian: sp.Expr, dissipation: sp.Expr, q: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Left-hand sides of `d/dt dL/dq' - dL/dq + dP/dq' = Q`, equation (1) of the paper."""
    return [
        sp.diff(lagrangian, sp.diff(c, t), t) - sp.diff(lagrangian, c) + sp.diff(dissipation, sp.diff(c, t)) for c in q
    ]


def generalised_force(points: Sequence[tuple[sp.Expr, sp.Expr]], q: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Generalised forces of forces on points, by virtual work: the sum of `force * d position / dq`.

    Args:
        points: pairs of a position's coordinate and the force along it.
        q: the generalised coordinates.
    """
    return [sum((force * sp.diff(place, c) for place, force in points), sp.Integer(0)) for c in q]


def mass_and_bias(equations: Sequence[sp.Expr], q: Sequence[sp.Expr]) -> tuple[sp.Matrix, sp.Matrix]:
    """`M` and `bias` of `M q'' + bias = Q`."""
    accelerations = [sp.diff(c, t, 2) for c in q]
    mass = sp.Matrix([[sp.diff(sp.expand(e), a) for a in accelerations] for e in equations])
    bias = sp.Matrix([sp.expand(e).subs(dict.fromkeys(accelerations, 0)) for e in equations])
    return mass, bias


def as_function(
    expression: sp.Expr | sp.Matrix, q: Sequence[sp.Expr], parameters: Sequence[sp.Symbol]
) -> Callable[[Sequence[float], Sequence[float], Sequence[float]], np.ndarray]:
    """A NumPy function of `(q, v, parameters)`."""
    place = [sp.Symbol(f"q_{i}") for i in range(len(q))]
    rate = [sp.Symbol(f"v_{i}") for i in range(len(q))]
    plain = sp.sympify(expression).subs({sp.diff(c, t): r for c, r in zip(q, rate, strict=True)})
    plain = plain.subs(dict(zip(q, place, strict=True)))
    compiled = sp.lambdify([place, rate, list(parameters)], plain, "numpy", cse=True)
    return lambda at, moving, values: np.asarray(compiled(at, moving, values), dtype=float)


def accelerations(
    equations: Sequence[sp.Expr], q: Sequence[sp.Expr], parameters: Sequence[sp.Symbol]
) -> Callable[[Sequence[float], Sequence[float], Sequence[float], Sequence[float]], np.ndarray]:
    """A NumPy function of `(q, v, parameters, forces)` that solves the equations for `q''`."""
    mass, bias = (as_function(part, q, parameters) for part in mass_and_bias(equations, q))

    def solve(
        at: Sequence[float], moving: Sequence[float], values: Sequence[float], forces: Sequence[float]
    ) -> np.ndarray:
        return np.linalg.solve(
            mass(at, moving, values), np.asarray(forces, dtype=float) - bias(at, moving, values).ravel()
        )

    return solve
