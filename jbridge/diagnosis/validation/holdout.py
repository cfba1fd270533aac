"""Recordings that prove a model, closed until its structure is fixed; taken from the others where none was given."""

from collections.abc import Sequence

from ...errors import InputError
from ...identification.data.thinning import thinned
from ...recordings import Recording


class HoldOut:
    """Recordings that take no part in the choice of a model.

    Only the validation opens them (`tests/test_architecture.py` holds this); no fit and no search is given one.
    """

    def __init__(self, recordings: Sequence[Recording]):
        self.names = tuple(recording.name for recording in recordings)
        self._recordings = tuple(recordings)

    def open(self) -> tuple[Recording, ...]:
        return tuple(map(thinned, self._recordings))


def split_off(recordings: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...], str]:
    """The last quarter of the recordings, or of the time of a single one, as hold-out.

    What only one recording shows is learned from it, so that this one is none of the hold-out.
    """
    if len(recordings) > 1:
        count = max(1, len(recordings) // 4)
        learned, proof = list(recordings), list[Recording]()
        for i in reversed(range(len(recordings))):
            rest = [*learned[:i], *learned[i + 1 :]]
            if len(proof) < count and _parts(learned[i]) <= frozenset[str]().union(*map(_parts, rest)):
                learned, proof = rest, [learned[i], *proof]
        if not proof:
            learned, proof = list(recordings[:-count]), list(recordings[-count:])
        names = ", ".join(r.name for r in proof)
        return (
            tuple(learned),
            tuple(proof),
            f"No hold-out was given: {names} is not used for estimation and serves as one.",
        )
    only = recordings[0]
    cut = int(0.75 * len(only.times))
    if min(cut, len(only.times) - cut) < 50:
        raise InputError(
            f"{only.name}: {len(only.times)} rows are too few to keep a quarter of them as hold-out; "
            "record longer, or give another recording with --holdout"
        )
    return (
        (only.rows(slice(None, cut)),),
        (only.rows(slice(cut, None)),),
        f"There is one recording: its last quarter, from {only.times[cut] - only.times[0]:.3g} s, took no part in the "
        "choice and serves as hold-out.",
    )


def _parts(recording: Recording) -> frozenset[str]:
    """The parts of the bridge that a recording shows."""
    return frozenset(part for part in ("has_cart", "has_swing", "has_hoist") if getattr(recording, part))
