"""Whether the gains of a model's drives go with what recordings show: where they do not, an input's unit is another."""

from collections.abc import Iterator, Sequence

from ..errors import InputError
from ..model.effects.drives import SpeedDrive
from ..model.files import Model
from ..recordings import GUESSED_GAIN, KNOWN_GAIN, Recording, contradiction, drive_gains, gain_remedy


def check_model_gains(model: Model, recordings: Sequence[Recording]) -> None:
    """Raises an InputError with the first sentence of `doubtful_gains`, if there is one."""
    for doubt in doubtful_gains(model, recordings):
        raise InputError(f"{doubt}; --force takes it as it is")


def doubtful_gains(model: Model, recordings: Sequence[Recording]) -> Iterator[str]:
    """Yields a sentence on each input that moves its axis far more, or less, than the model says it could.

    A force `K u` on a mass `m` with damping `R` gives the acceleration `K/m` and, in the end, the speed `K/R` per unit
    of input. Guesses may be rough. A known gain is held against the acceleration alone, since dampings never are known.

    Args:
        model: as given, gains known or guessed.
        recordings: of the rig.
    """
    bridge = model.plant.bridge
    hoist_mass = float(bridge.winch_mass + bridge.load_mass)
    axes = (
        ("u_x", "cart_gain", "cart_drive", float(bridge.cart_mass), float(bridge.cart_damping)),
        ("u_l", "hoist_gain", "hoist_drive", hoist_mass, float(bridge.hoist_damping)),
    )
    for recording in recordings:
        for name, parameter, site, mass, damping in axes:
            known = parameter in model.known or parameter in recording.override
            gain = recording.override.get(parameter, float(getattr(bridge, parameter)))
            expected = {"force": gain / mass} | ({"speed": gain / damping} if damping > 0 else {})
            if list(model.plant.all(SpeedDrive, site)):
                known, expected = False, {"speed": expected.get("speed", 0.0)}
            found = drive_gains(recording, name)
            if known and "force" in found:
                found = {"force": found["force"]}
            ratio = contradiction(found, expected, KNOWN_GAIN if known else GUESSED_GAIN)
            if ratio is not None:
                yield (
                    f"{recording.name}, column {name}: the rig moves {ratio:.2g} times as much per"
                    f" {recording.units[name]} as the model's {parameter} of {gain:.4g} lets it;"
                    f" {gain_remedy(recording, name, ratio)}, or correct {parameter}"
                )
