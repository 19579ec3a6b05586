"""Fixed sets of training phantoms: how many there are, that evaluation has others, and frames made once."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from stored import fresh_stores

import usbench  # noqa: F401, registers the environments
from usbench.checks import ConfigurationError
from usbench.envs import frames
from usbench.envs.tasks import phantom_distribution
from usbench.envs.tasks.phantom_distribution import FIRST_HELD_OUT, PhantomDistribution
from usbench.setting import Setting
from usbench.trials.configuration import resolve
from usbench.trials.evaluation import Evaluator


def numbers(env, n=60):
    env.unwrapped.is_watched = False
    return [env.reset(seed=0 if k == 0 else None)[1]["phantom"] for k in range(n)]


def test_training_draws_from_the_set_alone_and_its_streams_stay():
    few = Setting(task="pp-random", n_phantoms=3).make_env()
    every = Setting(task="pp-random").make_env()
    assert set(numbers(few)) == {0, 1, 2}
    # One number is drawn, whatever it becomes: starts are the same.
    assert [number % 3 for number in numbers(every)] == numbers(few)
    assert few.unwrapped.pose == every.unwrapped.pose


def test_evaluation_keeps_its_phantoms():
    setting = Setting(task="pp-random", n_phantoms=3)
    assert [phantom.seed for phantom in setting.evaluation_phantoms()] == [
        phantom.seed for phantom in Setting(task="pp-random").evaluation_phantoms()
    ]
    assert all(episode.phantom >= FIRST_HELD_OUT for episode in setting.evaluation_episodes())


def test_a_trial_records_its_set_and_has_a_name_of_its_own():
    every, few = resolve("dqn", "pp-random"), resolve("dqn", "pp-random", n_phantoms=20)
    assert every.hash != few.hash
    assert "count" not in every.environment["phantoms"]
    assert few.environment["phantoms"]["count"] == 20
    assert Setting.recorded(few).n_phantoms == 20
    assert Setting.recorded(every).n_phantoms is None


def test_a_set_is_named_by_a_digest_of_its_phantoms():
    few, other = (resolve("dqn", "pp-random", n_phantoms=n) for n in (20, 21))
    digest = few.environment["phantoms"]["digest"]
    assert digest == Setting(task="pp-random", n_phantoms=20).plain_env().phantoms.digest
    assert digest != other.environment["phantoms"]["digest"]
    assert few.phantom_set == f"20 training phantoms (set {digest})"
    # What is trained on without a limit is no set, and names of such trials stay.
    every = resolve("dqn", "pp-random")
    assert "digest" not in every.environment["phantoms"] and every.phantom_set == ""
    # As many phantoms of another distribution are another set.
    assert digest != resolve("dqn", "fp-random", n_phantoms=20).environment["phantoms"]["digest"]


def test_a_digest_tells_of_phantoms_that_are_drawn_otherwise(monkeypatch):
    phantoms = PhantomDistribution((0, 5), (50,), (0, 90), count=2)
    before, drawn = phantoms.digest, PhantomDistribution.phantom
    monkeypatch.setattr(PhantomDistribution, "phantom", lambda self, seed: drawn(self, seed + 1))
    # Past what is kept of the digest.
    assert phantom_distribution._digest.__wrapped__(phantoms) != before


def test_a_trial_of_another_set_is_refused():
    config = resolve("dqn", "pp-random", n_phantoms=20)
    phantoms = {**config.environment["phantoms"], "digest": "0123456789abcdef"}
    other = replace(config, environment={**config.environment, "phantoms": phantoms})
    with pytest.raises(ConfigurationError, match="20 training phantoms are the set '0123456789abcdef', but"):
        Setting.recorded(other)


@pytest.mark.parametrize("task", ["pp-random", "pp-tracked", "fp-random", "exam-random", "exam-tracked"])
def test_no_set_has_a_phantom_of_the_evaluation(task):
    largest = Setting(task=task, n_phantoms=FIRST_HELD_OUT).plain_env().phantoms
    rng = np.random.default_rng(0)
    assert max(largest.training_number(rng) for _ in range(1000)) < FIRST_HELD_OUT
    evaluated = Setting(task=task).evaluation_phantoms()
    assert min(phantom.seed for phantom in evaluated) >= FIRST_HELD_OUT
    # Nor is one of the evaluation a copy: none has the object of one that is trained on.
    trained = {largest.phantom(number).object_of_interest for number in range(200)}
    assert trained.isdisjoint(phantom.object_of_interest for phantom in evaluated)


def test_frames_of_a_set_are_simulated_once(monkeypatch):
    made = []

    def scan(phantom, pose, *_):
        made.append((phantom.seed, pose))
        return np.zeros((90, 40), np.uint8)

    monkeypatch.setattr(frames, "scan", scan)
    fresh_stores(monkeypatch)
    env = Setting(task="pp-random", n_phantoms=12).make_env()
    for k in range(300):
        env.reset(seed=k)
    assert len({number for number, _ in made}) == 12
    assert len(made) == len(set(made))


@pytest.mark.parametrize(
    ("task", "n_phantoms", "words"),
    [
        ("pp-random", 0, r"the number of phantoms must be a whole number in \[1, 2147483648\], not 0"),
        ("pp-random", 2**31 + 1, r"the number of phantoms must be a whole number in .*, not 2147483649"),
        ("pp-random", "all", "the number of phantoms must be a whole number in .*, not 'all'"),
        ("pp", 20, "n_phantoms is for tasks that draw phantoms .*'pp-random'.*, not for 'pp'"),
    ],
)
def test_refuses_sets_that_cannot_be(task, n_phantoms, words):
    with pytest.raises(ConfigurationError, match=words):
        Setting(task=task, n_phantoms=n_phantoms)


def test_an_environment_by_its_id_takes_a_set_too():
    env = gym.make("usbench/ProbePlaneRandom-v0", phantoms=PhantomDistribution((0,), (50,), (0, 90), count=2))
    assert set(numbers(env)) == {0, 1}


def test_anchors_of_other_episodes_are_those_of_their_phantoms():
    setting = Setting(task="pp-random", n_phantoms=1)
    episodes = tuple(replace(one, phantom=0) for one in setting.evaluation_episodes())
    target = setting.plain_env().phantoms.phantom(0).target
    expected = setting.process(target).returns(tuple(one.start for one in episodes))
    found = setting.anchors(episodes=episodes)
    assert (found.optimal, found.random) == pytest.approx((expected.optimal, expected.random))
    assert found.optimal != pytest.approx(setting.anchors().optimal)
    assert [episode.phantom for episode in Evaluator(setting, episodes).episodes] == [0] * len(episodes)
