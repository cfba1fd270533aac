"""Two effects that gain together what neither gains alone."""

import math

import numpy as np
import pytest

from jbridge.diagnosis.selection.pairs import paired
from jbridge.diagnosis.selection.screening import seen_among_all
from jbridge.diagnosis.structures.space import is_apart, make_space, proposals
from jbridge.diagnosis.structures.structure import base_structure
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import play
from tests.problems import NUMBERS, make_plant

PAIR = {("coulomb_friction", "swing"), ("load_drag", "swing")}


@pytest.mark.slow
def test_dry_friction_and_drag_of_a_free_swing_are_proposed_together():
    """Viscous damping fits the decay in between: less friction at its end, and less drag at its beginning."""
    true = make_plant(
        ("coulomb_friction", "swing", {"level": 2e-3}),
        ("load_drag", "swing", {"coefficient": 6e-3}),
        swing_damping=0.0,
    )
    runs = [
        play(true, np.zeros((2500, 2)), name=f"{i}.csv", active=(0.0, 1.0, 0.0), start={"psi": psi, "l": 0.7}, seed=i)
        for i, psi in enumerate((1.2, 0.5))
    ]
    known = frozenset({"load_mass", "gravity"})
    plant = make_plant(swing_damping=0.002)
    problem = make_problem(
        make_setting(Model(plant, known, frozenset(NUMBERS), {}, "m.toml"), runs, []), make_data(runs, (1.0, WHOLE))
    )
    problem, given = fit_structure(problem, plant, known)
    base = base_structure(problem, make_space(problem, plant, known, shared=False), given.point)
    among = seen_among_all(problem, problem, base)
    shared = [c for c in proposals(problem.setting, plant, known) if not is_apart(c.kind)]
    choice = {c.name: math.log(len(shared)) for c in shared}
    moves = paired(problem, problem, base, among, shared, choice)
    [move] = [move for move in moves if set(move.names) == PAIR]
    assert len(move.numbers) == 3  # both, and the damping
