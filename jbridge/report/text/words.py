"""What sites, kinds, variables and verdicts are called before a rig's owner."""

from collections.abc import Iterable, Mapping

from ...model.bridge import Bridge
from ...model.effects.catalogue import KINDS
from ...model.effects.fields import ParameterInfo, parameters_of
from ...model.names import kind_name, site_name, spaced

WRONG_VALUE = "wrong_value"
"""Kind of the explanation that nothing is missing but a known number is wrong; its site is the parameter's name."""

CHANNELS = {"x": "cart position x", "psi": "swing angle psi", "l": "rope length l"}
EQUATIONS = {"cart": "cart equation", "swing": "swing equation", "hoist": "hoist equation"}
AXIS_OF_EQUATION = {"cart": "x", "swing": "psi", "hoist": "l"}
VERDICTS = {
    "adequate": "The model is adequate",
    "missing_physics": "Physics is missing, and has a name",
    "unknown": "Something is missing that has no name yet",
}

_VARIABLES = {
    **CHANNELS,
    "v_x": "cart velocity",
    "v_psi": "swing rate",
    "v_l": "rope velocity",
    "u_x": "input of the cart drive u_x",
    "u_l": "input of the hoist drive u_l",
    "t": "time",
}
_UNITS = {"x": "m", "psi": "rad", "l": "m", "v_x": "m/s", "v_psi": "rad/s", "v_l": "m/s", "t": "s"}


def heading(verdict: str | None, kinds: Iterable[str]) -> str:
    """A verdict in a few words, given the kinds of what was named."""
    if verdict is None:
        return "Interrupted: no verdict"
    named = list(kinds)
    if verdict == "missing_physics" and named and all(kind == WRONG_VALUE for kind in named):
        return "A number of the model is wrong"
    return VERDICTS[verdict]


def effect_name(kind: str, site: str) -> str:
    """An explanation in a few words.

    >>> effect_name("dead_zone", "cart_drive"), effect_name("wrong_value", "load_mass")
    ('dead zone, cart drive', 'wrong value of the load mass')
    """
    if kind == WRONG_VALUE:
        return f"wrong value of the {spaced(site)}"
    return f"{kind_name(kind)}, {site_name(site)}"


def effect_meaning(kind: str, site: str) -> str:
    """What an explanation means, from the catalogue; empty where it has no such sentence.

    >>> effect_meaning("dead_zone", "cart_drive")
    'a dead zone of the cart drive: small inputs do nothing'
    """
    if kind == WRONG_VALUE:
        return f"the {spaced(site)} of the model file is not that of the rig"
    return KINDS[kind].sentence.format(axis=site_name(site)) if kind in KINDS else ""


def parameter_meaning(kind: str | None, key: str) -> str:
    """What a parameter of an effect, or of the bridge where `kind` is None, stands for; empty if unheard of."""
    info = _info(kind, key)
    return info.doc if info is not None else ""


def is_choice(kind: str | None, key: str) -> bool:
    """Whether a parameter is chosen, such as the places of a friction map, and never estimated."""
    info = _info(kind, key)
    return info is not None and not info.fitted


def _info(kind: str | None, key: str) -> ParameterInfo | None:
    owner = Bridge if kind is None else KINDS.get(kind)
    return parameters_of(owner).get(key) if owner is not None else None


def variable_name(variable: str) -> str:
    return _VARIABLES.get(variable, spaced(variable))


def variable_unit(variable: str, inputs: Mapping[str, str]) -> str:
    """SI unit of a variable, or the unit of an input; seconds for times since something, nothing where unheard of."""
    if variable in inputs:
        return inputs[variable]
    return _UNITS.get(variable, "s" if "time" in variable or "since" in variable else "")


def input_units(units: Mapping[str, str]) -> dict[str, str]:
    """Unit of each input, read off the unit of the bridge's gains; volts where there is no gain.

    >>> input_units({"cart_gain": "N/count"})
    {'u_x': 'count', 'u_l': 'V'}
    """
    gains = {"u_x": "cart_gain", "u_l": "hoist_gain"}
    return {name: units.get(gain, "N/V").partition("/")[2] or "V" for name, gain in gains.items()}


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]
