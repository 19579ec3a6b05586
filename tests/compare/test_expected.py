"""How long trials will take: what is told before the first one has ended."""

import pytest

from usbench.cli.output import sweep_output
from usbench.compare import expected
from usbench.compare.expected import Expected
from usbench.results import published, tables
from usbench.trials.configuration import resolve


def test_before_the_first_trial_the_published_ones_tell_how_long(tmp_path):
    table = tables.read(published.folder()).trials
    known = table[(table["algo"] == "ppo") & (table["steps"] == 16_064)]
    training, rest = known["training_s"].mean(), (known["total_s"] - known["training_s"]).mean()
    whole, half = (expected.by_published([("ppo", steps)] * 4, 2) for steps in (16_064, 8_032))
    assert whole == Expected(pytest.approx(2 * (training + rest)), published=True)
    assert half.seconds == pytest.approx(training + 2 * rest)
    # A trial cannot be split.
    assert expected.by_published([("ppo", 16_064)], 16).seconds == pytest.approx(training + rest)
    assert expected.by_published([("ppo", 64), ("mine:LongPPO", 64)], 2) is None
    config = resolve("ppo", "pp", steps=64)
    assert expected.trials([config], tmp_path, 1) == expected.by_published([("ppo", config.steps)], 1)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (Expected(7200.0, published=True), "about 2 h 0 min as in the published trials"),
        (Expected(600.0), "about 10 min"),
        (None, "no record tells how long"),
    ],
)
def test_the_line_says_whose_time_it_is(capsys, told, said):
    with sweep_output.SweepBars() as bars:
        bars.started(2, 0, told)
    assert capsys.readouterr().err.splitlines()[0] == f"2 trials to run, 0 finished already, {said}"
