"""Programs kept from run to run: traced once, told apart by all they depend on, and never in the way."""

import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge._types import Axes, Scalar
from jbridge.compilation import programs
from jbridge.compilation.programs import Program, keep_in
from jbridge.model.bridge import Bridge
from jbridge.model.effects.base import AbstractForce
from jbridge.model.effects.catalogue import KINDS, make_effect
from jbridge.model.fields import parameter
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Plant


@pytest.fixture
def folder(tmp_path):
    keep_in(tmp_path)
    yield tmp_path
    keep_in(None)


class Counted:
    """A function that counts how often Python runs it."""

    def __init__(self):
        self.traced = 0
        self.__qualname__ = self.__name__ = "counted"

    def __call__(self, power, point, more):
        self.traced += 1
        return Axes(point.x**power + more, jnp.sin(point.psi), point.l), None, more.sum()


POINT = Axes(np.arange(3.0), np.ones(3), np.float64(0.5) * np.ones(3))


def test_a_second_run_finds_the_program_and_answers_the_same(folder):
    first, second = Counted(), Counted()
    expected = jax.jit(Counted(), static_argnums=0)(2, POINT, np.ones(3))
    for function in (first, second):  # two objects, as two processes have
        found = Program(function, (0,))(2, POINT, np.ones(3))
        assert isinstance(found[0], Axes)
        jax.tree.map(np.testing.assert_array_equal, found, expected)
    assert (first.traced, second.traced) == (1, 0)


@pytest.mark.parametrize(
    "other",
    [
        (3, POINT, np.ones(3)),
        (2, POINT, np.ones(1)),
        (2, jax.tree.map(np.float32, POINT), np.ones(3, np.float32)),
        (2, POINT, jnp.asarray(1.0) * 1),
    ],
    ids=["constant", "shape", "precision", "rank"],
)
def test_whatever_changes_the_program_makes_another_one(folder, other):
    with jax.numpy_rank_promotion("allow"):
        Program(Counted(), (0,))(2, POINT, np.ones(3))
        function = Counted()
        found = Program(function, (0,))(*other)
        assert function.traced == 1
        jax.tree.map(np.testing.assert_array_equal, found, jax.jit(Counted(), static_argnums=0)(*other))


def test_other_sources_or_versions_have_a_folder_of_their_own(folder, monkeypatch):
    Program(Counted(), (0,))(2, POINT, np.ones(3))
    monkeypatch.setattr(programs, "_version", lambda: "another")
    keep_in(folder)
    function = Counted()
    Program(function, (0,))(2, POINT, np.ones(3))
    assert function.traced == 1


def test_what_has_not_run_for_long_is_removed(folder, monkeypatch):
    Program(Counted(), (0,))(2, POINT, np.ones(3))
    (old,) = folder.iterdir()
    monkeypatch.setattr(programs, "_version", lambda: "another")
    keep_in(folder)
    assert old.exists()
    monkeypatch.setattr(programs, "_DAYS_KEPT", -1)
    keep_in(folder)
    assert not old.exists()


def test_a_damaged_file_is_replaced(folder):
    Program(Counted(), (0,))(2, POINT, np.ones(3))
    (path,) = folder.glob("*/*")
    whole = path.read_bytes()
    turned = bytearray(whole)
    turned[len(whole) // 2] ^= 1
    for damaged in (whole[: len(whole) // 2], b"", b"\0" * 100, bytes(turned)):
        path.write_bytes(damaged)
        function = Counted()
        found = Program(function, (0,))(2, POINT, np.ones(3))
        assert function.traced == 1
        np.testing.assert_array_equal(found[0].x, POINT.x**2 + 1)
        assert len(path.read_bytes()) == len(whole)


def test_inside_another_program_it_is_an_ordinary_function(folder):
    program = Program(Counted(), (0,))
    slope = jax.grad(lambda more: program(2, POINT, more)[2])(jnp.ones(3))
    np.testing.assert_array_equal(slope, np.ones(3))
    assert not list(folder.glob("*/*"))


class Wind(AbstractForce):
    """A user's own force, whose source no version knows."""

    kind = "wind"
    sites = ("cart",)
    sentence = "wind"
    size: Scalar = parameter("N", "size")
    site: str = eqx.field(static=True)

    def force(self, t, q, v):
        return Axes(self.size, 0.0 * self.size, 0.0 * self.size)

    @classmethod
    def seeds(cls, site, scene):
        return []


def test_of_effects_from_elsewhere_nothing_is_kept(folder):
    """Their sources may change between two runs, and nothing in a file's name would tell."""
    own = Plant(Bridge(), (Wind(jnp.asarray(1.0), "cart"),))
    by_argument = Program(lambda plant: plant.effects[0].size, ())
    by_constant = Program(lambda table, vector: table.unravel(vector).effects[0].size, (0,))
    table = ParameterTable(own)
    assert by_argument(own) == by_constant(table, table.ravel(own)) == 1.0
    assert not list(folder.glob("*/*"))
    # The same of the package's own plants is kept.
    ours = Plant(Bridge(), (make_effect("constant_force", "cart", {}),))
    assert Program(lambda plant: plant.bridge.cart_mass, ())(ours) == ours.bridge.cart_mass
    assert len(list(folder.glob("*/*"))) == 1


def test_what_cannot_be_kept_runs_all_the_same(folder):
    def noisy(x):
        jax.debug.callback(lambda x: None, x)
        return 2.0 * x

    assert Program(noisy, ())(np.ones(3)).sum() == 6.0
    assert not list(folder.glob("*/*"))


def test_a_folder_that_cannot_be_written_changes_nothing(folder, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(programs.os, "replace", full)
    assert Program(Counted(), (0,))(2, POINT, np.ones(3))[2] == 3.0
    assert not list(folder.glob("*/*"))


def test_settings_that_change_traces_are_told_apart(folder):
    program = Program(Counted(), (0,))
    assert program(2, POINT, np.ones(3))[0].x.dtype == np.float64
    with jax.enable_x64(False):
        assert program(2, POINT, np.ones(3))[0].x.dtype == np.float32


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Program(Counted(), (0,))(2, POINT, np.ones(3))[2] == 3.0
    assert not list(tmp_path.iterdir())


def test_a_table_says_all_that_tells_it_from_others():
    """Programs are kept under what a table says of itself: what is equal must read the same, and nothing else may."""
    plants = [Plant(Bridge(), ())]
    for kind, cls in KINDS.items():
        plants += [Plant(Bridge(), (make_effect(kind, site, {}),)) for site in cls.sites]
    plants += [Plant(Bridge(), (*a.effects, *b.effects)) for a, b in zip(plants[1:], plants[2:], strict=False)]
    tables = [ParameterTable(plant) for plant in plants]
    said = [repr(table) for table in tables]
    assert len(set(said)) == len(said) == len(set(tables))
    assert said == [repr(ParameterTable(jax.tree.map(lambda leaf: leaf + 1.0, plant))) for plant in plants]
    assert not any(" at 0x" in text for text in said)


def test_what_was_forgotten_is_read_again(folder):
    counted = Counted()
    program = Program(counted, (0,))
    first = program(2, POINT, np.ones(3))
    assert len(program._loaded) == 1
    programs.forget()
    assert not program._loaded
    again = program(2, POINT, np.ones(3))
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert len(program._loaded) == 1 and counted.traced == 1


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says how large a process is")
def test_programs_are_forgotten_once_a_process_is_large(folder, monkeypatch):
    program = Program(Counted(), (0,))
    program(2, POINT, np.ones(3))
    monkeypatch.setattr(programs, "_without", 0.0)
    monkeypatch.setattr(programs, "_LARGE", 2.0**50)
    programs.forget_if_large()
    assert program._loaded
    monkeypatch.setattr(programs, "_LARGE", 0.0)
    monkeypatch.setattr(programs, "_GROWN", 0.0)
    programs.forget_if_large()
    assert not program._loaded
    # What did not grow since then would not get smaller.
    program(2, POINT, np.ones(3))
    monkeypatch.setattr(programs, "_GROWN", 2.0**40)
    programs.forget_if_large()
    assert program._loaded
    monkeypatch.setattr(programs, "_GROWN", 0.0)
    # Without a folder they would have to be made anew.
    program(2, POINT, np.ones(3))
    monkeypatch.setattr(programs, "_folder", None)
    programs.forget_if_large()
    assert program._loaded
