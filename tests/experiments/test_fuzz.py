"""No file can crash a reader: damaged files of every kind are read, or refused with one line."""

import os
import sys
import time
from pathlib import Path

import pytest

HERE = Path(__file__).parents[2] / "experiments" / "fuzz"
sys.path.insert(0, str(HERE))  # the scripts of an experiment import their neighbours by plain names

import corpus  # noqa: E402
import mutate  # noqa: E402
import workers  # noqa: E402


@pytest.mark.parametrize(("seed", "count"), [(1, 200), pytest.param(2, 1000, marks=pytest.mark.slow)])
def test_damaged_files_are_read_or_refused(seed, count):
    """Within 10 s and 1 GB each, with no traceback, signal or warning. Most are refused, and some are read."""
    cases = corpus.corpus()
    found = list(workers.outcomes(mutate.mutant(cases, number, seed) for number in range(count)))
    assert [outcome for outcome in found if not outcome.sound] == []
    read = sum(outcome.kind == "read" for outcome in found)
    assert 0.1 * count < read < 0.5 * count


@pytest.mark.parametrize(
    ("reader", "kind"),
    [
        (lambda path: None, "read"),
        (lambda path: corpus.jbridge.load_model(path / "absent"), "refused"),
        (lambda path: 1 / 0, "traceback"),
        (lambda path: bytearray(2 * workers.MEMORY), "memory"),
        (lambda path: workers.warnings.warn("odd"), "traceback"),
    ],
    ids=["nothing", "refusal", "bug", "memory", "warning"],
)
def test_outcomes_are_told_apart(reader, kind, tmp_path, monkeypatch):
    monkeypatch.setitem(corpus.READERS, "this", reader)
    limit = workers.resource.getrlimit(workers.resource.RLIMIT_DATA)
    workers.resource.setrlimit(workers.resource.RLIMIT_DATA, (workers._used() + workers.MEMORY, limit[1]))
    try:
        assert workers.read(corpus.Case("this", "x", "x", {"x": b""}), tmp_path).kind == kind
    finally:
        workers.resource.setrlimit(workers.resource.RLIMIT_DATA, limit)


class Received:
    """Calls a function in the process that receives it."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.slow
def test_a_worker_that_ends_or_hangs_is_replaced(monkeypatch):
    monkeypatch.setattr(workers, "SECONDS", 2.0)
    whole = corpus.corpus()[0]
    ends = corpus.Case("recording", "x", "x", {"x": Received(os.abort)})
    hangs = corpus.Case("recording", "x", "x", {"x": Received(time.sleep, 60.0)})
    kinds = [outcome.kind for outcome in workers.outcomes([whole, ends, whole, hangs, whole])]
    assert kinds == ["read", "signal", "read", "time", "read"]
