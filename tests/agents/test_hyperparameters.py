"""Hyperparameters as the command line takes them."""

import pytest

from usbench.agents import zoo
from usbench.agents.hyperparameters import as_set, parse


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (True, "true"),
        (False, "false"),
        (10_000_000, "10000000"),
        (1.0, "1"),
        (5e-05, "5e-05"),
        (-130.0, "-130"),
        (-6.666667, "-6.666667"),
        (0.12345678, "0.12345678"),
        (1 / 3, "0.3333333333333333"),
        (None, "None"),
    ],
)
def test_a_value_is_as_short_as_it_stays_the_same(value, said):
    assert as_set({"name": value}) == [f"name={said}"]


@pytest.mark.parametrize("algo", zoo.ZOO)
def test_what_is_written_is_read_back(algo):
    entry = zoo.ZOO[algo]
    for values in (entry.hyperparameters, entry.options, *entry.tasks.values(), *entry.presets.values()):
        read = [text.split("=") for text in as_set(values)]
        assert {name: parse(name, text) for name, text in read} == values
