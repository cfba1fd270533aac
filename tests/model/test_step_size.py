"""Steps against the eigenvalues of the bridge at rest."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge._types import Axes
from jbridge.model.equations import Stage, Step, accelerations
from jbridge.model.plant import Motion, Plant
from jbridge.model.step_size import allows_order_4, longest_step, stiff_axes, substeps
from tests.problems import make_plant

RIGID = 0.005
HIDDEN = {"belt_compliance": "motor", "backlash": "motor", "rope_elasticity": "loaded", "double_pendulum": "phi"}


@eqx.filter_jit
def jacobian(plant, names: tuple[str, ...], state):
    active, none = Axes(*(jnp.ones(()) for _ in range(3))), Axes(*(jnp.zeros(()) for _ in range(3)))

    def rates(state):
        halves = jnp.split(state, 2)
        q, v = (Motion(**dict(zip(names, half, strict=True))) for half in halves)
        time, step = jnp.zeros(()), jnp.asarray(1e-9)
        a = accelerations(plant, Stage(time, q, v, none), Step(q, v, step, active, jnp.asarray(True)))
        return jnp.concatenate([halves[1], jnp.stack([getattr(a, name) for name in names])])

    return jax.jacfwd(rates)(state)


def fastest(plant) -> float:
    """The largest eigenvalue [1/s] of the motion around the load hanging at 0.7 m."""
    names = ("x", "psi", "l", *(HIDDEN[effect.kind] for effect in plant.effects))
    rest = {"x": 0.3, "psi": 0.0, "l": 0.7, "motor": 0.3, "loaded": 0.7, "phi": 0.0}
    state = jnp.array([*(rest[name] for name in names), *(0.0 for _ in names)])
    return float(np.abs(np.linalg.eigvals(np.asarray(jacobian(plant, names, state)))).max())


def rope(stiffness: float, damping: float) -> tuple[str, str, dict]:
    return "rope_elasticity", "hoist", {"stiffness": stiffness, "damping": damping}


def hook(mass: float, link: float, damping: float) -> tuple[str, str, dict]:
    return "double_pendulum", "swing", {"hook_mass": mass, "link": link, "damping": damping}


@pytest.mark.parametrize(
    "plant",
    [
        make_plant(hoist_damping=600.0),
        make_plant(cart_mass=0.2, cart_damping=120.0),
        make_plant(rope(3e4, 1.0)),
        make_plant(rope(1e6, 50.0)),
        make_plant(rope(2e3, 80.0), hoist_damping=0.0),
        make_plant(rope(5e3, 0.5), load_mass=6.0),
        make_plant(hook(0.01, 0.006, 1e-5)),
        make_plant(hook(0.01, 0.05, 2e-3)),
        make_plant(("backlash", "cart", {"gap": 0.001, "motor_mass": 0.05})),
    ],
    ids=[
        "winch",
        "light-cart",
        "rope",
        "wire",
        "damped-rope",
        "heavy-load",
        "short-link",
        "damped-link",
        "light-motor",
    ],
)
def test_no_step_is_too_long_for_the_fastest_motion_nor_much_too_short(plant):
    step, rate = longest_step(plant, RIGID), fastest(plant)
    # Both methods are stable to 2 at least; a power of two and the modes' mixing make a step shorter than it need be.
    assert 0.1 < step * rate <= 1.05


def test_a_rigid_bridge_keeps_its_step_and_hidden_masses_take_half():
    assert longest_step(make_plant(), RIGID) == RIGID
    soft = make_plant(("belt_compliance", "cart", {"stiffness": 2e3, "damping": 5.0, "motor_mass": 2.0}))
    assert longest_step(soft, RIGID) == RIGID / 2


def test_what_is_decided_within_a_step_does_not_ask_for_ever_shorter_ones():
    stiff = make_plant(("belt_compliance", "cart", {"stiffness": 1e9, "damping": 5.0, "motor_mass": 2.0}))
    assert longest_step(stiff, RIGID) == RIGID / 8


@pytest.mark.parametrize("kind", ["back_emf", "freewheeling"])
def test_a_drive_that_is_wired_the_other_way_round_brakes_as_well(kind):
    """With both signs exchanged, of gain and input, nothing changes."""
    more = {"width": 1.0} if kind == "freewheeling" else {}
    plant = make_plant((kind, "cart_drive", {"constant": 2.0, **more}))
    other = Plant(dataclasses.replace(plant.bridge, cart_gain=-plant.bridge.cart_gain), plant.effects)
    zero, moving = Motion(*(jnp.zeros(()) for _ in range(6))), Motion(*(jnp.full((), 0.3) for _ in range(6)))
    force, same = (
        float(p.drive_forces(Axes(jnp.asarray(u), jnp.zeros(()), jnp.zeros(())), zero, moving).x)
        for p, u in ((plant, 1.5), (other, -1.5))
    )
    assert force == pytest.approx(same) and force < float(plant.bridge.cart_gain) * 1.5
    assert longest_step(other, RIGID) == longest_step(plant, RIGID)


def test_of_many_bridges_the_fastest_decides():
    plants = [make_plant(rope(stiffness, 1.0)) for stiffness in (1e3, 1e5)]
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *plants)
    assert longest_step(both, RIGID) == longest_step(plants[1], RIGID) < longest_step(plants[0], RIGID)
    assert substeps(both, 0.02, RIGID) == round(0.02 / longest_step(plants[1], RIGID))


@pytest.mark.parametrize(
    ("plant", "axes", "order_4"),
    [
        (make_plant(), (), True),
        (make_plant(cart_damping=2e3), ("x",), True),
        (make_plant(("backlash", "cart", {"gap": 0.001})), (), True),
        (make_plant(("backlash", "cart", {"gap": 0.001}), cart_damping=2e3), ("x",), False),
        # The wire asks for shorter steps still.
        (make_plant(rope(1e6, 50.0), hoist_damping=600.0), (), True),
    ],
)
def test_damping_is_solved_in_closed_form_where_steps_get_longer(plant, axes, order_4):
    assert stiff_axes(plant) == axes
    assert allows_order_4(plant, axes) == order_4
