"""The paper's tests on the device: ramps along the rail, free decays, winch tests, steps."""

import math
from collections.abc import Iterator

from virtual import LENGTHS, RAIL, Law


def ramps(peak: float, rise: float, side: float = 1.0) -> Law:
    """Ramps of voltage that carry the cart along the rail to the right and back, ascending and descending.

    Args:
        peak: of every ramp [V].
        rise: time from 0 to the peak [s]; after as long again at rest the next one follows.
        side: 1 to begin to the right, -1 to the left.
    """
    state = {"side": side, "since": 0.0}

    def law(t: float, reading: dict[str, float]) -> tuple[float, float]:
        within = t - state["since"]
        if within >= 2.2 * rise:
            state["since"], within = t, 0.0
            if reading["x"] > RAIL[1] - 0.22:
                state["side"] = -1.0
            elif reading["x"] < RAIL[0] + 0.22:
                state["side"] = 1.0
        up = within / rise
        share = up if up < 1.0 else max(0.0, 1.6 - 0.6 * up) if up < 1.3 else 0.0
        return state["side"] * peak * share, 0.0

    return law


def at_rest(t: float, reading: dict[str, float]) -> tuple[float, float]:
    """Free decay: nothing is driven."""
    return 0.0, 0.0


def winch(volts: float, hold: float) -> Law:
    """Pulses of the winch, up and down, of growing and shrinking voltage."""
    state = {"side": 1.0, "since": 0.0, "count": 0}

    def law(t: float, reading: dict[str, float]) -> tuple[float, float]:
        if t - state["since"] >= hold:
            state["since"], state["count"] = t, state["count"] + 1
            if reading["l"] > LENGTHS[1] - 0.2:
                state["side"] = -1.0
            elif reading["l"] < LENGTHS[0] + 0.2:
                state["side"] = 1.0
        if state["count"] % 2:
            return 0.0, 0.0
        size = volts * (0.55 + 0.45 * math.sin(1.1 * state["count"]) ** 2)
        # Downwards the load helps, upwards it must be lifted.
        return 0.0, size if state["side"] > 0 else -1.7 * size

    return law


def steps(volts: float, hold: float, pause: float) -> Law:
    """One step to the right and one back, as in the paper's Figure 4."""

    def law(t: float, reading: dict[str, float]) -> tuple[float, float]:
        if t < pause:
            return 0.0, 0.0
        if t < pause + hold:
            return volts, 0.0
        if t < 2 * pause + hold:
            return 0.0, 0.0
        return (-volts if t < 2 * (pause + hold) else 0.0), 0.0

    return law


def plan() -> Iterator[tuple[str, Law, float, dict[str, float]]]:
    """Name, law, length [s] and start of every test from which the model is estimated."""
    yield "ramps-1", ramps(1.6, 0.6), 24.0, {"x": 0.0, "l": 0.7}
    yield "ramps-2", ramps(1.1, 1.0), 28.0, {"x": 0.0, "l": 0.7}
    yield "ramps-3", ramps(2.0, 0.4, -1.0), 20.0, {"x": 1.3, "l": 0.7}
    for length in (0.3, 0.5, 0.7, 0.9):
        yield f"decay-{length:g}", at_rest, 10.0, {"x": 0.65, "psi": math.radians(12.0), "l": length}
    yield "winch-1", winch(3.0, 0.5), 14.0, {"x": 0.65, "l": 0.3}
    yield "winch-2", winch(2.2, 0.8), 16.0, {"x": 0.65, "l": 0.8}
