"""The concealed rig as a MuJoCo scene: slide, hinge, slide, and more joints where mechanics is hidden.

Cart: a slide. Rope and load: a hinge at the pivot, then a slide along the rope, whose armature is the
winch. A belt or backlash parts the cart from the motor by a relative slide (spring, or free within a
limit); an elastic rope or a play at the winch adds a slide beyond the length paid out; a hook adds a second
hinge. Dry friction is the engine's own friction-loss constraint.
"""

import mujoco

from effects import Effect, Layout

DT = 2e-4
"""Engine step [s]. Constraints settle within two of these, so stuck axes creep less than 1 um/s."""
_HARD = f"{2 * DT} 1"
_STIFF = "0.9999 0.9999 0.001"


def _find(effects: list[Effect], *kinds: str) -> Effect | None:
    return next((e for e in effects if e["kind"] in kinds), None)


def _mass(mass: float) -> str:
    # A point mass: the engine asks for some inertia, 1e-9 kg m^2 is a hundred-millionth of load_mass l^2.
    return f'<inertial pos="0 0 0" mass="{mass:.12g}" diaginertia="1e-9 1e-9 1e-9"/>'


def _dry(kind: str, name: str, damping: float, more: str) -> str:
    """A joint that can carry dry friction; its level is set while running."""
    return (
        f'<joint name="{name}" type="{kind}" damping="{damping:.12g}" frictionloss="1e-12" '
        f'solreffriction="{_HARD}" solimpfriction="{_STIFF}" {more}/>'
    )


def _rod(rod: Effect, hinge: str, below: str) -> str:
    """A rod that turns about the pivot and is not hoisted; what is below slides along it."""
    turned = f"{rod['inertia']:.12g}"
    own = f'mass="{rod["mass"]:.12g}" diaginertia="{turned} {turned} 1e-9"'
    return f'<body name="rod">{hinge}<inertial pos="0 0 {-rod["centre"]:.12g}" {own}/>{below}</body>'


def _rope(bridge: dict, effects: list[Effect], length: float, winch: bool) -> str:
    elastic, double = _find(effects, "rope_elasticity"), _find(effects, "double_pendulum")
    play = _find(effects, "hoist_backlash")
    rod = _find(effects, "rod_inertia")
    above = 0.0 if rod else length
    hinge = _dry("hinge", "psi", bridge["swing_damping"], f'axis="0 -1 0" pos="0 0 {above:.12g}"')
    joints = "" if rod else hinge
    if winch:
        turning = play["motor_mass"] if play else bridge["winch_mass"]
        more = f'axis="0 0 -1" ref="{length:.12g}" armature="{turning:.12g}"'
        joints += _dry("slide", "l", bridge["hoist_damping"], more)
    if elastic:
        joints += (
            f'<joint name="stretch" type="slide" axis="0 0 -1" stiffness="{elastic["stiffness"]:.12g}" '
            f'damping="{elastic["damping"]:.12g}"/>'
        )
    if play:
        joints += (
            f'<joint name="stretch" type="slide" axis="0 0 -1" limited="true" '
            f'range="{-play["gap"] / 2:.12g} {play["gap"] / 2:.12g}" '
            f'solreflimit="{_HARD}" solimplimit="{_STIFF}"/>'
        )
    if not double:
        load = f'<body name="load" pos="0 0 {-length:.12g}">{joints}{_mass(bridge["load_mass"])}</body>'
        return _rod(rod, hinge, load) if rod else load
    hook = (
        f'<joint name="link" type="hinge" axis="0 -1 0" pos="0 0 {double["link"]:.12g}" '
        f'damping="{double["damping"]:.12g}"/>'
    )
    lower = _mass(bridge["load_mass"] - double["hook_mass"])
    chain = (
        f'<body name="hook" pos="0 0 {-length:.12g}">{joints}{_mass(double["hook_mass"])}'
        f'<body name="load" pos="0 0 {-double["link"]:.12g}">{hook}{lower}</body></body>'
    )
    return _rod(rod, hinge, chain) if rod else chain


def _drum(bridge: dict, effects: list[Effect], winch: bool) -> str:
    """The inertia of a drum that turns with the rope's end and not with the motor: on the sum of both slides."""
    play = _find(effects, "hoist_backlash")
    if not (play and winch):
        return ""
    turning = bridge["winch_mass"] - play["motor_mass"]
    sides = '<joint joint="l" coef="1"/><joint joint="stretch" coef="1"/>'
    return f'<tendon><fixed armature="{turning:.12g}">{sides}</fixed></tendon>'


def build(truth: dict, length: float) -> tuple[mujoco.MjModel, Layout]:
    """The scene of one recording.

    Args:
        truth: `bridge`, `effects`, `parts` ("full", "cart", "pendulum"), `rope` ("winch", "locked").
        length: rope length at the start, and for good where the rope is locked [m].
    """
    bridge, effects, parts = truth["bridge"], truth["effects"], truth["parts"]
    winch = parts != "cart" and truth["rope"] == "winch"
    rope = "" if parts == "cart" else _rope(bridge, effects, length, winch)
    parted = _find(effects, "belt_compliance", "backlash")
    slide = "" if parts == "pendulum" else _dry("slide", "x", bridge["cart_damping"], 'axis="1 0 0"')
    cart_mass = bridge["cart_mass"] if parts != "pendulum" else 1.0
    if parted:
        if parted["kind"] == "belt_compliance":
            more = f'stiffness="{parted["stiffness"]:.12g}" damping="{parted["damping"]:.12g}"'
        else:
            half = parted["gap"] / 2
            more = f'limited="true" range="{-half:.12g} {half:.12g}" '
            more += f'solreflimit="{_HARD}" solimplimit="{_STIFF}"'
        play = f'<joint name="play" type="slide" axis="1 0 0" {more}/>'
        cart = _mass(cart_mass - parted["motor_mass"])
        body = f'<body name="cart">{play}{cart}{rope}</body>'
        body = f'<body name="motor">{slide}{_mass(parted["motor_mass"])}{body}</body>'
    else:
        body = f'<body name="cart">{slide}{_mass(cart_mass)}{rope}</body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{DT}" gravity="0 0 {-bridge["gravity"]:.12g}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{body}</worldbody>{_drum(bridge, effects, winch)}</mujoco>"
    )
    at = {model.joint(i).name: i for i in range(model.njnt)}
    double = _find(effects, "double_pendulum")
    return model, Layout(**at, rope=length, link_length=double["link"] if double else 0.0)
