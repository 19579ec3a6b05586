"""The checks of what a user passes: plain numbers come out, and each refusal is one sentence."""

import ast
import math
import reprlib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from usbench import checks

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("value", [3, 3.0, np.int16(3), np.float32(3)])
def test_numbers_come_out_plain(value):
    assert type(checks.number("x", value)) is float and checks.number("x", value) == 3
    assert type(checks.whole_number("x", value, 3, 3)) is int
    assert checks.positive("x", value) == checks.non_negative("x", value) == 3


def test_numbers_are_never_minus_zero():
    assert str(checks.number("x", -0.0)) == str(checks.non_negative("x", np.float32(-0.0))) == "0.0"


@pytest.mark.parametrize("seed", [3.0, np.float32(3), np.float64(3)])
def test_a_seed_is_no_float_even_a_whole_one(seed):
    with pytest.raises(TypeError, match="seed must be a whole number"):
        checks.check_seed(seed)
    assert checks.check_seed(np.int64(3)) == 3


@pytest.mark.parametrize("check", [checks.number, checks.positive, checks.whole_number, checks.probability])
@pytest.mark.parametrize("value", ["3", None, True, np.True_, [1.0], 1j])
def test_refuses_what_is_no_number(check, value):
    with pytest.raises(TypeError, match=r"^x must be a .*, not .*\.$"):
        check("x", value)


@pytest.mark.parametrize("check", [checks.number, checks.positive, checks.whole_number, checks.probability])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_refuses_what_is_not_finite(check, value):
    with pytest.raises(ValueError, match=rf"^x must be a .*, not {value}\.$"):
        check("x", value)


def test_intervals_are_open_or_closed():
    assert checks.number("x", 0, low=0, high=1) == 0 and checks.number("x", 1, low=0, high=1) == 1
    for value, ends in ((0, {"above": True}), (1, {"below": True})):
        with pytest.raises(ValueError, match="x must be a number in"):
            checks.number("x", value, low=0, high=1, **ends)


@pytest.mark.parametrize(
    ("check", "words"),
    [
        (lambda: checks.number("x", math.nan), "x must be a finite number, not nan."),
        (lambda: checks.positive("x", 0), "x must be a positive number, not 0."),
        (lambda: checks.non_negative("x", -1), "x must be a non-negative number, not -1."),
        (lambda: checks.number("x", 3, low=0, high=1, above=True), "x must be a number in (0, 1], not 3."),
        (lambda: checks.probability("noise", 1.5), "noise must be a probability in [0, 1], not 1.5."),
        (lambda: checks.whole_number("x", 2.5), "x must be a whole number, not 2.5."),
        (lambda: checks.whole_number("x", 0, low=1), "x must be a whole number from 1, not 0."),
        (
            lambda: checks.whole_number("x", Fraction(10**400, 3)),
            "x must be a whole number, not " + reprlib.repr(Fraction(10**400, 3)) + ".",
        ),
        (lambda: checks.whole_number("x", 9, 1, 4), "x must be a whole number in [1, 4], not 9."),
    ],
)
def test_says_what_is_allowed(check, words):
    with pytest.raises(ValueError) as caught:
        check()
    assert str(caught.value) == words


def test_a_long_value_is_cut():
    with pytest.raises(ValueError, match="x must be a finite number, not 9{10}.*9{10}.$"):
        checks.number("x", 10**400 - 1)
    with pytest.raises(TypeError) as caught:
        checks.number("x", "9" * 10_000)
    assert len(str(caught.value)) < 100


@pytest.mark.parametrize(
    ("name", "allowed", "words"),
    [
        ("FP", ("fp", "pp"), "unknown task 'FP' (did you mean 'fp'?): allowed are 'fp', 'pp'."),
        ("zzz", ["fp"], "unknown task 'zzz': allowed are 'fp'."),
        (7, {"fp": 1}, "unknown task 7: allowed are 'fp'."),
        ("fp", (), "unknown task 'fp': allowed are none."),
    ],
)
def test_unknown_names_say_the_closest(name, allowed, words):
    assert str(checks.unknown("task", name, allowed)) == words


def test_no_other_module_checks_numbers_by_hand():
    """Such a check once stood in seven modules, each with other words."""
    allowed = {"checks.py", "hyperparameters.py"}
    for folder in ("envs", "agents", "usbench"):
        for path in (ROOT / folder).rglob("*.py"):
            nodes = [*ast.walk(ast.parse(path.read_text()))]
            names = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
            names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
            own = {"numbers", "difflib"} & names
            assert not own or path.name in allowed, f"{path.relative_to(ROOT)} imports {own}"


def test_an_extra_is_installed_in_a_clone_with_the_tested_versions():
    assert "(in a clone: pip install -c constraints.txt -e '.[minari]')" in checks.install("minari")
