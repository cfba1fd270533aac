"""How a parameter or an option of an effect, or of the bridge, is declared: its unit, bounds and null value."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array


def _as_float(value: Any) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """What is known of a parameter before any recording is seen.

    `unit` is written with the placeholders `{force}`, `{position}`, `{speed}` and `{input}`, which the site fills in.
    """

    name: str
    unit: str
    null: float
    """Value at which the effect is absent (or, for a shape, any harmless value)."""
    low: float
    high: float
    fitted: bool
    """Whether it is ever estimated from recordings (knots and reference lengths are choices)."""
    vector: bool
    optional: bool
    reciprocal: bool
    """Whether a fit steps in one over it, because motions are nearly linear in that: in a spring's compliance."""
    doc: str
    key: str
    """Its name in model files and reports (a field may not carry the name of a method)."""


def parameter(  # noqa: PLR0913
    unit: str,
    doc: str,
    *,
    null: float = 0.0,
    low: float = -math.inf,
    high: float = math.inf,
    fitted: bool = True,
    vector: bool = False,
    reciprocal: bool = False,
    default: Any = dataclasses.MISSING,
    key: str = "",
) -> Any:
    """Declares a parameter field of an effect or of the bridge, with what `ParameterInfo` lists."""
    assert low > 0.0 or not reciprocal
    metadata = {
        "parameter": dict(
            unit=unit,
            doc=doc,
            null=null,
            low=low,
            high=high,
            fitted=fitted,
            vector=vector,
            optional=default is not dataclasses.MISSING,
            reciprocal=reciprocal,
            key=key,
        )
    }
    return eqx.field(converter=_as_float, default=default, metadata=metadata)


def option(default: str, choices: tuple[str, ...]) -> Any:
    """Declares a choice by word, such as the end of the rail.

    The field holds the word's index as a number, so that both choices share one compiled program.
    """

    def index_of(word: Any) -> Array:
        if isinstance(word, str):
            if word not in choices:
                raise ValueError(f"{word!r} is not one of {', '.join(choices)}")
            return _as_float(choices.index(word))
        return _as_float(word)

    return eqx.field(converter=index_of, default=default, metadata={"choices": choices})


def parameters_of(cls: type) -> dict[str, ParameterInfo]:
    """The parameters of an effect class (or of `Bridge`), by key and in order."""
    infos = {}
    for field in dataclasses.fields(cls):
        if "parameter" in field.metadata:
            told = dict(field.metadata["parameter"])
            key = told.pop("key") or field.name
            infos[key] = ParameterInfo(field.name, key=key, **told)
    return infos


def options_of(cls: type) -> dict[str, tuple[str, ...]]:
    """The options of an effect class with their allowed words."""
    return {field.name: field.metadata["choices"] for field in dataclasses.fields(cls) if "choices" in field.metadata}
