"""Controllers and references from files: what is written is read back, and what is wrong is said in one line."""

import equinox as eqx
import numpy as np
import pytest

from jbridge import InputError
from jbridge.control.compensation import Compensation
from jbridge.control.extended_rules import extended_controller
from jbridge.control.files import Controller, load_controller, save_controller
from jbridge.control.paper_rules import cart_system, hoist_system, paper_controller
from jbridge.control.reference_files import load_reference, paper_path
from jbridge.fuzzy.files.fis_writer import save_fis


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "fuzzy.toml"
    save_controller(path, Controller(paper_controller(), 0.02))
    return path


def test_a_controller_comes_back_as_it_was(written):
    found = load_controller(written)
    assert eqx.tree_equal(found.law, paper_controller()) and found.period == 0.02


def test_a_compensation_and_relative_speeds_come_back_too(tmp_path):
    law = extended_controller(Compensation(cart=0.3, hoist=1.0, hoist_bias=-0.5))
    save_controller(tmp_path / "extended.toml", Controller(law, 0.02))
    assert eqx.tree_equal(load_controller(tmp_path / "extended.toml").law, law)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("relative_speed = true", "relative_speed = 1"), "relative_speed = 1 is neither true nor false"),
        (("blur = 0.05", "blur = 0.0"), r"\[compensation\]: blur = 0.0 is not a positive number"),
        (("cart = 0.3", "cart = true"), r"\[compensation\]: cart = true is not a number"),
        (("hoist_bias", "bias"), "unknown key 'bias'"),
    ],
)
def test_what_is_wrong_with_a_compensation_is_said(tmp_path, change, complaint):
    path = tmp_path / "extended.toml"
    save_controller(path, Controller(extended_controller(Compensation(cart=0.3)), 0.02))
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change, 1))
    with pytest.raises(InputError, match=complaint):
        load_controller(path)


def test_fuzzy_systems_may_lie_in_files_of_their_own(tmp_path):
    """As MATLAB writes them; scales and period stay in the TOML."""
    save_fis(tmp_path / "a.fis", cart_system())
    save_fis(tmp_path / "b.fis", hoist_system())
    path = tmp_path / "fuzzy.toml"
    path.write_text(
        'kind = "fuzzy"\ncart = "a.fis"\nhoist = "b.fis"\ncart_scale = 3.0\nhoist_scale = 3.0\nangle_unit = "deg"\n'
    )
    assert eqx.tree_equal(load_controller(path).law, paper_controller())


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('kind = "fuzzy"', 'kind = "magic"'), "unknown kind 'magic'"),
        (("period = 0.02", "period = 0"), "period = 0 is not a positive number"),
        (("cart_scale", "cart_scales"), "unknown key 'cart_scales'; did you mean 'cart_scale'"),
        (('aggregation = "max"', 'aggregation = "mean"'), "unknown aggregation 'mean'"),
        (("points = 101", "points = 1"), "points = 1 is not a number of points"),
        (("points = 101", "points = 1000000000"), "points = 1000000000 is not a number of points"),
        (("period = 0.02", "period = 1e-300"), "period = 1e-300 s is not from 0.0001 to 1"),
        (("period = 0.02", f"period = {'[' * 5000}"), "nested more than 20 deep"),
        (("period = 0.02", "period = 0.02\nx." + "a." * 50 + "b = 1"), "'x.a.a.*nested more than 20 deep"),
        (("period = 0.02", "period = 36893488147419103232"), "'period': an integer of more than 64 bits"),
        (("if error is NB then voltage is NB", "if error is NB then voltage"), r"\[cart\]: rules\[0\]: .*expected"),
        (("if error is ZE", "if mistake is ZE"), "'mistake' is none of error, velocity, angle"),
        (
            ("trapmf = [-1.0, -1.0, -0.08, -0.004]", "trapmf = [-1.0, -1.0, -0.08]"),
            "has 3 numbers; it needs left",
        ),
        (("trimf = [-0.08, -0.004, 0.0]", "trimf = [0.0, -0.004, -0.08]"), "NS.trimf has corners that do not ascend"),
        (("trimf = [-0.08, -0.004, 0.0]", "tri = [-0.08, -0.004, 0.0]"), "unknown set of NS 'tri'"),
        (("range = [-3.0, 3.0]", "range = [3.0, -3.0]"), "range does not go from a lower to a higher end"),
        (("weights = [1.0, ", "weights = ["), "does not give one number for each of the 9 rules"),
    ],
)
def test_what_is_wrong_with_a_controller_is_said(written, change, complaint):
    text = written.read_text()
    assert change[0] in text
    written.write_text(text.replace(*change, 1))
    with pytest.raises(InputError, match=complaint) as found:
        load_controller(written)
    assert str(written) in str(found.value) and "\n" not in str(found.value)


def test_the_papers_reference():
    """From T_z by T_1 to T_2, smooth, within its speeds, at rest at both goals."""
    path = paper_path(0.02)
    np.testing.assert_allclose([path.x[0], path.l[0]], [0.0, 0.185])
    np.testing.assert_allclose([path.x[-1], path.l[-1]], [0.5, 0.3], atol=1e-12)
    assert np.isclose(path.x, 1.2).sum() * 0.02 >= 4.0 and np.isclose(path.l, 0.6).sum() * 0.02 >= 4.0
    assert np.abs(path.v_x).max() <= 0.3 + 1e-12 and np.abs(path.v_l).max() <= 0.2
    np.testing.assert_allclose(np.gradient(path.x, path.times)[5:-5], path.v_x[5:-5], atol=2e-3)
    assert np.abs(np.diff(path.v_x)).max() < 0.02 * 0.5


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("points = [[0.0, 0.3]]", "add at least two"),
        ("points = [[0.0, 0.3], [1.0]]", r"points\[1\] = \[1.0\] is not a pair"),
        ("points = [[0.0, 0.3], [1.0, -0.2]]", "rope length -0.2; it must be positive"),
        ("points = [[0.0, 0.3], [1.0, 0.2]]\nspeed = [0.0, 1.0]", "is not positive"),
        ("points = [[0.0, 0.3], [1.0, 0.2]]\nrest = -1", "rest = -1 is not a time"),
        ("point = [[0.0, 0.3], [1.0, 0.2]]", "unknown key 'point'; did you mean 'points'"),
        ("points = [[0.0, 0.3], [1.0, 0.2]]\nrest = 999999.0", "takes 1e.06 s, more than 1,000,000 entries of 0.02 s"),
        ("points = [[0.0, 0.3], [1.0, 0.2]]\nspeed = [1e-300, 0.1]", "takes .* s, more than 1,000,000 entries"),
        ("points = [[0.0, 0.3], [1.0, 0.2]]\nspeed = [5e-324, 5e-324]", "takes inf s, more than 1,000,000 entries"),
    ],
)
def test_what_is_wrong_with_a_reference_is_said(tmp_path, text, complaint):
    path = tmp_path / "reference.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        load_reference(path, 0.02)
