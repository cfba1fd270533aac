"""Whether the gains of a model's drives go with what recordings show: where they do not, an input's unit is another."""

from collections.abc import Iterator, Sequence

from ..errors import InputError
from ..model.effects.motors import SpeedDrive
from ..model.files import Model
from ..recordings import FAR_GAIN, GUESSED_GAIN, KNOWN_GAIN, Recording, contradiction, drive_gains, gain_remedy


def check_model_gains(model: Model, recordings: Sequence[Recording]) -> None:
    """Raises an InputError with the first sentence of `doubtful_gains` on what is known, if there is one."""
    for doubt, known in doubtful_gains(model, recordings):
        if known:
            raise InputError(f"{doubt}; --force takes it as it is")


def doubtful_gains(model: Model, recordings: Sequence[Recording]) -> Iterator[tuple[str, bool]]:
    """Yields a sentence on each input that moves its axis far more, or less, than the model says it could, and whether
    its gain and masses are known.

    A force `K u` on a mass `m` with damping `R` gives the acceleration `K/m` and, in the end, the speed `K/R` per unit
    of input. Guesses may be rough: a fit begins with them all the same. Known ones are held against the acceleration
    alone, since dampings never are known.

    Args:
        model: as given.
        recordings: of the rig.
    """
    bridge = model.plant.bridge
    axes = (
        ("u_x", "cart_gain", "cart_drive", ("cart_mass",), float(bridge.cart_damping)),
        ("u_l", "hoist_gain", "hoist_drive", ("winch_mass", "load_mass"), float(bridge.hoist_damping)),
    )
    for recording in recordings:
        for name, parameter, site, masses, damping in axes:
            mass = sum(float(getattr(bridge, each)) for each in masses)
            known = {parameter, *masses} <= model.known | set(recording.override)
            gain = recording.override.get(parameter, float(getattr(bridge, parameter)))
            expected = {"force": gain / mass} | ({"speed": gain / damping} if damping > 0 else {})
            if list(model.plant.all(SpeedDrive, site)):
                known, expected = False, {"speed": expected.get("speed", 0.0)}
            found = drive_gains(recording, name)
            if known and "force" in found:
                found = {"force": found["force"]}
            limits = (KNOWN_GAIN, FAR_GAIN) if known else (GUESSED_GAIN, GUESSED_GAIN)
            ratio = contradiction(found, expected, *limits)
            if ratio is not None:
                doubt = (
                    f"{recording.name}, column {name}: the rig moves {ratio:.2g} times as much per"
                    f" {recording.units[name]} as the model's {parameter} of {gain:.4g} predicts;"
                    f" {gain_remedy(recording, name, ratio)}, or correct {parameter}"
                )
                yield doubt, known
