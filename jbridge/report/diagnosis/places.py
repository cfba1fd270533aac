"""Where and when a mismatch sits, in sentences."""

from ...diagnosis.result import Diagnosis
from ..text.quantities import Scale, join_unit, percent, scale_for
from ..text.rows import units_of
from ..text.words import input_units, variable_name, variable_unit


def where_sentences(diagnosis: Diagnosis) -> list[str]:
    """One sentence per region; speeds and small lengths in mm, angles in degrees."""
    inputs = input_units(units_of(diagnosis.bridge))
    sentences = []
    for region in diagnosis.location.where:
        scale = scale_for(variable_unit(region.variable, inputs), [region.low, region.high])
        sentences.append(
            f"{percent(region.share)} of the mismatch lies where the {variable_name(region.variable)} is between"
            f" {_number(region.low, scale)} and {join_unit(_number(region.high, scale), scale.unit)}."
        )
    return sentences


def when_sentences(diagnosis: Diagnosis) -> list[str]:
    """One sentence per recording, with its intervals."""
    intervals: dict[str, list[str]] = {}
    for interval in diagnosis.location.when:
        intervals.setdefault(interval.recording, []).append(f"{interval.start:.1f} to {interval.stop:.1f} s")
    training = {trace.recording for trace in diagnosis.traces if trace.role == "train"}
    if len(intervals) > 1 and set(intervals) == training and len({tuple(spans) for spans in intervals.values()}) == 1:
        spans = next(iter(intervals.values()))
        return [f"In each of {len(intervals)} recordings it is largest at {', '.join(spans)}."]
    return [f"In {recording} it is largest at {', '.join(spans)}." for recording, spans in intervals.items()]


def _number(value: float, scale: Scale) -> str:
    return f"{scale.factor * value:.3g}"
