"""What sites, kinds, variables and verdicts are called before a rig's owner."""

from collections.abc import Iterable, Mapping

from ..._types import AXES, AXIS_OF_EQUATION
from ...diagnosis.structures.candidates import WRONG_VALUE
from ...model.bridge import Bridge
from ...model.effects.catalogue import KINDS
from ...model.fields import ParameterInfo, parameters_of
from ...model.names import QUANTITIES, kind_name, quantity_name, site_name, spaced

CHANNELS = {axis: f"{quantity_name(axis)} {axis}" for axis in AXES}
EQUATIONS = {name: f"{name} equation" for name in AXIS_OF_EQUATION}
VERDICTS = {
    "adequate": "The model is adequate",
    "missing_physics": "Missing physics is identified",
    "unknown": "Physics is missing and not identified",
}


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
    """A variable with its symbol, where that is a column of recordings."""
    name = quantity_name(variable)
    return f"{name} {variable}" if variable in (*AXES, "u_x", "u_l") else name


def variable_unit(variable: str, inputs: Mapping[str, str]) -> str:
    """SI unit of a variable, or the unit of an input; seconds for times since something, nothing where unheard of."""
    if variable in inputs:
        return inputs[variable]
    if variable in QUANTITIES:
        return QUANTITIES[variable][1]
    return "s" if "time" in variable or "since" in variable else ""


def input_units(units: Mapping[str, str]) -> dict[str, str]:
    """Unit of each input, read off the unit of the bridge's gains; volts where there is no gain.

    >>> input_units({"cart_gain": "N/count"})
    {'u_x': 'count', 'u_l': 'V'}
    """
    gains = {"u_x": "cart_gain", "u_l": "hoist_gain"}
    return {name: units.get(gain, "N/V").partition("/")[2] or "V" for name, gain in gains.items()}


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]
