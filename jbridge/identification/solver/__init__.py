"""Reweighted Gauss-Newton over parameters and the initial states of windows."""

from .bounds import bounded_step
from .gauss_newton import Limits, solve
from .prediction_errors import Point, Start, evaluate, mean_squares, residual, residuals, squares
from .variable_projection import Normal, moved_states, normal_equations

__all__ = [
    "Limits",
    "Normal",
    "Point",
    "Start",
    "bounded_step",
    "evaluate",
    "mean_squares",
    "moved_states",
    "normal_equations",
    "residual",
    "residuals",
    "solve",
    "squares",
]
