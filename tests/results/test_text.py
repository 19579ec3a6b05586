"""Numbers and names in words."""

import math
import shlex

from usbench.results import text


def test_numbers_have_fixed_digits_and_zero_has_no_sign():
    assert text.number(-0.0001, 2) == "0.00" and text.number(1.005, 1) == "1.0"
    assert text.number(math.nan, 2) == text.bounds(math.nan, math.nan) == text.DASH


def test_interval_stands_in_brackets_where_there_is_one():
    assert text.interval(0.5, 0.4, 0.6) == "0.500 [0.400, 0.600]"
    assert text.interval(0.5, math.nan, math.nan, 2) == "0.50"


def test_names_in_a_row():
    assert text.names(["a"]) == "`a`"
    assert text.pairs_of([("a", "b"), ("c", "d")]) == "`a` lies above `b`, `c` above `d`"
    assert text.names(["a", "b", "c"]) == "`a`, `b` and `c`"


def test_escaped_names_are_no_markup():
    assert text.escaped("exam-stop") == "exam-stop"
    assert text.escaped("a](b)`<c>") == "a&#93;&#40;b&#41;&#96;&#60;c&#62;"


def test_a_long_command_breaks_at_no_options_value_and_is_the_same_for_the_shell():
    command = "usbench run --algo double_dqn --task exam-random --seed 102 --senses actions focus --quiet"
    told = text.in_lines(command)
    assert [line.split()[-1] for line in told.replace("\\\n", "\n").splitlines()] == ["102", "--quiet"]
    assert shlex.split(told.replace("\\\n", " ")) == command.split()
    assert all(len(line) <= 78 for line in told.splitlines())
