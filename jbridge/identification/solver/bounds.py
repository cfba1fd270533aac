"""A damped Gauss-Newton step of parameters within their bounds."""

import numpy as np
from numpy.typing import NDArray


def bounded_step(
    matrix: NDArray[np.float64],
    gradient: NDArray[np.float64],
    least: NDArray[np.float64],
    most: NDArray[np.float64],
    damping: float,
) -> NDArray[np.float64]:
    """Minimises a damped quadratic within bounds, by Newton steps on what is not held there (Bertsekas 1982).

    Args:
        matrix, gradient: of the quadratic.
        least, most: how far each number may go.
        damping: Levenberg-Marquardt's, over the diagonal.
    """
    n = len(gradient)
    # In units in which every parameter alone weighs the same: a belt's 1e4 N/m beside a gain of 1e-3 N/count would
    # otherwise be below what the solver takes for nothing.
    unit = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.maximum(unit, max(1e-18 * unit.max(initial=0.0), 1e-150))
    scaled = matrix / np.outer(unit, unit) + (damping + 1e-13) * np.eye(n)
    slope, low, high = gradient / unit, least * unit, most * unit
    step, value = np.clip(np.zeros(n), low, high), 0.0
    for _ in range(2 * n + 2):
        now = slope + scaled @ step
        moving = np.flatnonzero(~(((step <= low) & (now > 0)) | ((step >= high) & (now < 0))))
        if not len(moving):
            break
        newton = np.zeros(n)
        newton[moving] = np.linalg.lstsq(scaled[np.ix_(moving, moving)], -now[moving], rcond=1e-15)[0]
        share, before = 1.0, value
        while share > 1e-3:
            trial = np.clip(step + share * newton, low, high)
            found = float(slope @ trial + 0.5 * trial @ scaled @ trial)
            if found < value:
                step, value = trial, found
                break
            share *= 0.5
        if not before - value > 1e-10 * abs(value):
            break
    return np.clip(step / unit, least, most)
