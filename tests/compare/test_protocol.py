"""The protocol: what the file says, what of it is refused, and that seeds of the pools never meet."""

import protocols
import pytest

from usbench.agents import zoo
from usbench.compare import protocol
from usbench.records import ConfigurationError


def refusal(path):
    with pytest.raises(ConfigurationError) as refused:
        protocol.read(path)
    text = str(refused.value)
    assert text.endswith(".") and "\n" not in text
    return text


def test_own_protocol_keeps_what_its_page_says():
    own = protocol.read()
    assert own.is_of_the_package
    assert own.search.candidates == 16 and own.search.n_trials() == (64, 24)
    steps = sum(n * rung.steps for n, rung in zip(own.search.n_trials(), own.search.rungs, strict=True))
    assert steps == 642_560 == 40 * 16_064
    assert own.search.tasks == ("fp", "pp") and own.search.noises == (0.0, 0.5)
    assert own.comparison.seeds == 10
    learners = {name for name, row in zoo.ZOO.items() if row.learns and row.compared}
    assert set(own.search.rows) == set(own.comparison.rows) == learners


def test_pools_share_no_seed():
    pools = protocol.read().pools
    for seed in (0, 9, 100, 999, 1000, 1999):
        assert sum(seed in pool for pool in (pools.development, pools.comparison, pools.search)) == 1
    assert pools.of(9) == "development" and pools.of(100) == "comparison" and pools.of(1000) == "search"
    assert pools.of(50) == ""


def test_comments_and_order_change_no_digest(tmp_path):
    one = protocol.read(protocols.write(tmp_path))
    other = protocol.read(protocols.write(tmp_path, ("candidates = 3", "# of each\ncandidates = 3")))
    assert one.digest == other.digest and not one.is_of_the_package
    assert protocol.read(protocols.write(tmp_path, ("candidates = 3", "candidates = 4"))).digest != one.digest


@pytest.mark.parametrize(
    ("purpose", "seed", "said"),
    [
        ("search", 100, "a search takes seeds 1000 to 1999, not 100, which is of the pool for comparison."),
        ("search", 3, "which is of the pool for development."),
        ("comparison", 1000, "takes seeds 100 to 999, not 1000, which is of the pool for search."),
        ("comparison", 5000, "which is of no pool."),
    ],
)
def test_seed_of_the_wrong_pool_is_refused(purpose, seed, said):
    with pytest.raises(ConfigurationError) as refused:
        protocol.read().pools.check(purpose, seed)
    assert said in str(refused.value)


def test_more_seeds_than_the_pool_has_are_refused():
    with pytest.raises(ConfigurationError, match=r"at most 900 seeds \(100 to 999\), not 901\."):
        protocol.read().comparison_seeds(901)


def test_no_pools_make_a_search_see_the_seeds_of_the_benchmark_s_comparison(tmp_path):
    swapped = [
        ("first = 100,", "first = 3000,"),
        ("last = 999", "last = 3999"),
        ("first = 1000,", "first = 100,"),
    ]
    path = protocols.write(tmp_path, *swapped, ("[1000]", "[100]"))
    with pytest.raises(ConfigurationError, match="takes no seed from 100 to 999, which is kept"):
        protocol.read(path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("seeds = [1001]", "seeds = [100]"), "takes seeds 1000 to 1999, not 100"),
        (("seeds = 2\n", "seeds = 901\n"), "takes seeds 100 to 999, not 1000"),
        (("first = 100,", "first = 9,"), "the pools 0 to 9 and 9 to 999 share seeds"),
        (("seeds = [1001]", "seeds = [1000]"), "the rungs share seeds"),
        (("keep = 1", "keep = 2"), "the last rung must keep 1 candidate, not 2"),
        (("keep = 2", "keep = 4"), "a rung of 3 candidates cannot keep 4"),
        (('"a2c", "vpg"', '"a2x"'), "'a2x' (did you mean 'a2c'?)"),
        (('rows = ["a2c"]', 'rows = ["ppq"]'), "did you mean 'ppo'"),
        (('tasks = ["pp"]', 'tasks = ["ppp"]'), "did you mean 'pp'"),
        (('tasks = ["pp"]', 'tasks = ["pp-random"]'), "search on pp"),
        (('tasks = ["pp"]', 'tasks = ["pp-tracked"]'), "search on fp, pp, exam"),
        (
            ("seeds = 2\n", 'seeds = 2\n[[comparison.extras]]\nname = "a"\nnoises = [0.0]\nseeds = 901\n'),
            "not 1000",
        ),
        (("last = 999", "last = 99"), "must not end before it begins, as 100 to 99 does"),
        (("candidates = 3", "candidates = 0"), "its search.candidates cannot be 0"),
        (("candidates = 3", "candidates = 1001"), "its search.candidates cannot be 1001"),
        (("candidates = 3", "candidates = 100"), "space of 'vpg' holds 36 different candidates, not 100"),
        (("candidates = 3", 'candidates = "many"'), "its search.candidates cannot be 'many'"),
        (("candidates = 3", ""), "it has no search.candidates"),
        (("candidates = 3", "candidate = 3\ncandidates = 3"), "search.candidate is not known"),
        (("noises = [0.0, 0.5]", "noises = [1.5]"), "cannot be 1.5"),
        (("[pools]", "[pools"), "cannot be used"),
        (("candidates = 3", "candidates = 2019-01-01"), "cannot be used: Object of type date"),
    ],
)
def test_protocols_that_cannot_be_used_are_refused(tmp_path, changes, said):
    assert said in refusal(protocols.write(tmp_path, changes))


def test_missing_file_is_refused(tmp_path):
    assert "cannot be read" in refusal(tmp_path / "none.toml")
