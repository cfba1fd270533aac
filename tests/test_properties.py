"""Properties of files that hold whatever Hypothesis thinks of: what is written reads back, what is read is data."""

import dataclasses
import tomllib

import equinox as eqx
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jbridge
from jbridge import InputError
from jbridge._toml import as_key, as_value
from jbridge.control.paper_rules import paper_controller
from jbridge.fuzzy.files.fis_reader import load_fis
from jbridge.fuzzy.files.fis_writer import save_fis

# Examples follow from the tests' own names, so that every run has the same; files are replaced from one to the next.
FIXED = settings(
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
SCALARS = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8"), max_size=12)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=12,
)
ODD = st.sampled_from(["not", "is", "then", "and", "", " ", "a b", "don't", "N", "n", "x=1", "'", '"', "#", "[Input1]"])
LABELS = st.lists(ODD | st.text(max_size=8), min_size=5, max_size=5)


@FIXED
@given(st.dictionaries(st.text(max_size=8), VALUES, max_size=5))
def test_values_written_as_toml_read_back(table):
    text = "\n".join(f"{as_key(key)} = {as_value(value)}" for key, value in table.items())
    assert tomllib.loads(text) == table


def relabelled(labels):
    """The paper's rules for the cart, with other names of the sets of its error."""
    system = paper_controller().cart
    first = dataclasses.replace(system.inputs[0], labels=tuple(labels))
    return dataclasses.replace(system, inputs=(first, *system.inputs[1:]))


@FIXED
@given(LABELS)
def test_rules_with_any_labels_come_back_or_are_not_written(tmp_path, labels):
    system = relabelled(labels)
    path = tmp_path / "s.fis"
    path.unlink(missing_ok=True)
    try:
        save_fis(path, system)
    except InputError:
        assert not path.exists()
    else:
        assert eqx.tree_equal(load_fis(path), system)


@FIXED
@given(LABELS)
def test_controllers_with_any_labels_come_back_or_are_not_written(tmp_path, labels):
    law = dataclasses.replace(paper_controller(), cart=relabelled(labels))
    path = tmp_path / "c.toml"
    path.unlink(missing_ok=True)
    try:
        jbridge.save_controller(path, jbridge.Controller(law))
    except InputError:
        assert not path.exists()
    else:
        assert eqx.tree_equal(jbridge.load_controller(path).law, law)


KEYS = """bridge effect known kind site level cart_mass gravity columns x unit trim start sample vary name low high
count model controller points speed rest locked l""".split()
WORDS = "coulomb_friction cart cart_drive mm deg sobol grid cart_gain c.toml ../x fuzzy pid".split()
NUMBERS = st.sampled_from([0, -1, 1e308, -0.0, 1e-320, 2**63 - 1, float("inf"), 0.5])
TREES = st.recursive(
    st.sampled_from(WORDS) | NUMBERS | SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4),
    max_leaves=15,
)
DOCUMENTS = st.dictionaries(st.sampled_from(KEYS), TREES, min_size=1, max_size=6)
READERS = {
    "model": jbridge.load_model,
    "controller": jbridge.load_controller,
    "reference": lambda path: jbridge.load_reference(path, 0.02),
    "sweep": lambda path: jbridge.load_sweep(path).seconds,
}


def read_or_refused(reader, path):
    """What a reader makes of a file: it reads it, or refuses it with one line that names it."""
    try:
        reader(path)
    except InputError as refusal:
        assert path.name in str(refusal) and "\n" not in str(refusal)


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
@FIXED
@given(document=DOCUMENTS)
def test_any_document_is_read_or_refused(tmp_path, reader, document):
    path = tmp_path / "any.toml"
    path.write_text("\n".join(f"{as_key(key)} = {as_value(value)}" for key, value in document.items()) + "\n")
    read_or_refused(reader, path)


NAMES = st.sampled_from(["t", "time", "u_x", "u_l", "x", "psi", "theta", "l", "X", "x_mm", "volt", ""])
CELLS = "0 1 -1e308 1e308 nan inf 0,5 0.25 1e-320 abc".split()
CELLS = st.sampled_from([*CELLS, "", "5.0 V", "\x00"])


@FIXED
@given(
    names=st.lists(NAMES, min_size=1, max_size=6),
    rows=st.lists(st.lists(CELLS | st.floats(-9, 9).map(repr), min_size=1, max_size=7), max_size=14),
    separator=st.sampled_from([",", ";", "\t", " "]),
    even=st.booleans(),
)
def test_any_table_is_a_recording_or_refused(tmp_path, names, rows, separator, even):
    if even:  # a clock that runs, and rows as wide as the head
        rows = [[repr(0.01 * k), *(row * 7)[: len(names) - 1]] for k, row in enumerate(rows)]
        names = ["t", *names[1:]]
    path = tmp_path / "any.csv"
    path.write_text("\n".join(separator.join(row) for row in [names, *rows]) + "\n")
    read_or_refused(jbridge.load_recording, path)


@FIXED
@given(
    size=st.floats(1e-6, 1e3),
    offset=st.floats(-1e6, 1e6),
    sign=st.sampled_from([1, -1]),
    channel=st.sampled_from(["x", "psi"]),
)
def test_counts_of_any_size_from_any_zero_are_undone(channel, size, offset, sign):
    """A column in counts is, with the sidecar that says so, the recording that it was: to rounding of the counts."""
    t = np.arange(300) * 0.01
    columns = {"t": t, "u_x": np.sign(np.sin(5 * t)), "x": 0.1 * np.sin(t), "psi": 0.05 * np.sin(4 * t)}
    wanted = columns[channel]
    counts = {**columns, channel: sign * wanted / size + offset}
    told = {"column": channel, "unit": "count", "scale": size, "sign": sign, "offset": offset}
    sidecar = {"columns": {channel: told}, "locked": {"l": 0.7}}
    found = jbridge.Recording.from_arrays(**counts, sidecar=sidecar, force=True)
    assert np.abs(getattr(found, channel) - wanted).max() < 1e-15 + 4 * np.finfo(float).eps * size * (
        abs(offset) + np.abs(wanted / size).max()
    )
