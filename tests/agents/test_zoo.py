import inspect
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import zoo
from usbench.agents.baselines import Oracle, Random, Stay
from usbench.agents.hyperparameters import RANGES
from usbench.agents.vpg import VPG


class Noise(gym.Env[np.ndarray, int]):
    """Images of noise, five actions, four steps; counts its steps."""

    observation_space = gym.spaces.Box(-3, 3, (8, 8, 2), np.float32)
    action_space = gym.spaces.Discrete(5)
    steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.left = 4
        return self._image(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.steps += 1
        self.left -= 1
        return self._image(), 0.0, False, self.left == 0, {}

    def _image(self) -> np.ndarray:
        return self.np_random.uniform(-3, 3, (8, 8, 2)).astype(np.float32)


class Plan:
    """Says what it was asked for."""

    def action(self, step: int, pose: tuple[int, int, int]) -> int:
        return (step + sum(pose)) % 5


IMAGES = np.zeros((1000, 8, 8, 2), np.float32)


def test_table_holds_the_papers_hyperparameters() -> None:
    assert zoo.hyperparameters("vpg", "pp", {}) == {
        "learning_rate": 1e-4,
        "value_learning_rate": 1e-3,
        "n_steps": 64,
        "gamma": 0.99,
        "gae_lambda": 0.97,
        "n_value_steps": 3,
        "initial_value": -130.0,
        "adam_beta1": 0.0,
    }
    assert zoo.hyperparameters("vpg", "fp", {})["gae_lambda"] == 0.95
    assert zoo.hyperparameters("vpg", "pp", {}, preset="spinup")["n_value_steps"] == 80
    # The rewards of both versions are positive; the trials of the first, made under its later name, had this.
    assert {zoo.hyperparameters("vpg", task)["initial_value"] for task in ("setup", "setup-v0")} == {140.0}


def test_the_table_itself_is_within_the_ranges() -> None:
    for algo, row in zoo.ZOO.items():
        for values in (row.hyperparameters, *row.tasks.values(), *row.presets.values()):
            assert values.keys() <= row.hyperparameters.keys()
            assert zoo.hyperparameters(algo, "pp", values) == {**zoo.hyperparameters(algo, "pp"), **values}


def test_overrides_win_over_preset_and_task() -> None:
    merged = zoo.hyperparameters("vpg", "fp", {"n_value_steps": "3", "gae_lambda": "0.5"}, preset="spinup")
    assert (merged["n_value_steps"], merged["gae_lambda"]) == (3, 0.5)


def test_options_are_recorded_where_they_differ_from_their_defaults() -> None:
    plain = zoo.hyperparameters("double_dqn", "pp-tracked")
    assert "greedy_shift_px" not in plain
    assert zoo.hyperparameters("double_dqn", "pp-tracked", {"greedy_shift_px": "0"}) == plain
    changed = zoo.hyperparameters("double_dqn", "pp-tracked", {"greedy_shift_px": "2"})
    assert changed == plain | {"greedy_shift_px": 2}
    with pytest.raises(ValueError, match=r"greedy_shift_px must be a whole number in \[0, 10\], not 11"):
        zoo.hyperparameters("double_dqn", "pp-tracked", {"greedy_shift_px": "11"})


def test_options_have_the_defaults_of_their_classes() -> None:
    found = 0
    for algo, row in zoo.ZOO.items():
        for name, value in row.options.items():
            assert inspect.signature(zoo.model_class(algo).__init__).parameters[name].default == value
            found += 1
    assert found


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("n_value_steps", "80", 80),
        ("learning_rate", "1e-3", 1e-3),
        ("gamma", "1", 1.0),
        ("n_steps", " 16 ", 16),
    ],
)
def test_text_is_parsed_to_the_declared_type(name: str, text: str, value: object) -> None:
    parsed = zoo.hyperparameters("vpg", "pp", {name: text})[name]
    assert parsed == value
    assert type(parsed) is type(value)


def test_truth_values_are_parsed() -> None:
    from usbench.agents.hyperparameters import Boolean

    assert [Boolean().parse(text) for text in ("true", "False")] == [True, False]
    with pytest.raises(TypeError):
        Boolean().check("x", Boolean().parse("1"))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            {"n_value_steps": "eighty"},
            r"^n_value_steps must be a whole number in \[1, 10000\], not 'eighty'.$",
        ),
        ({"n_value_steps": "8.5"}, "n_value_steps must be"),
        ({"n_value_steps": "0"}, "n_value_steps must be"),
        ({"n_value_steps": True}, "n_value_steps must be"),
        ({"n_steps": "9" * 5000}, "n_steps must be"),
        ({"gamma": "nan"}, r"gamma must be a number in \(0, 1\]"),
        ({"gamma": "inf"}, "gamma must be"),
        ({"gamma": "2.0"}, "gamma must be"),
        ({"gamma": ""}, "gamma must be"),
        ({"gamma": None}, "gamma must be"),
        ({"learning_rate": "0"}, "learning_rate must be"),
        ({"learning_rate": [1e-3]}, "learning_rate must be"),
        (
            {"n_valuesteps": "8"},
            "unknown hyperparameter of vpg 'n_valuesteps' .did you mean 'n_value_steps'",
        ),
        ({"policy": "x"}, "unknown hyperparameter of vpg 'policy'"),
    ],
)
def test_refuses_overrides(overrides: dict[str, object], words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        zoo.hyperparameters("vpg", "pp", overrides)
    assert "\n" not in str(caught.value)


# Stable-Baselines3 takes every one of these without a word, and trains on it or breaks later.
@pytest.mark.parametrize(
    ("algo", "name", "text"),
    [
        ("ppo", "gamma", "2.0"),
        ("ppo", "clip_range", "-0.2"),
        ("ppo", "ent_coef", "-1"),
        ("ppo", "vf_coef", "nan"),
        ("ppo", "max_grad_norm", "0"),
        ("ppo", "n_epochs", "0"),
        ("ppo", "batch_size", "1"),
        ("ppo", "normalize_advantage", "yes"),
        ("a2c", "use_rms_prop", "1"),
        ("dqn", "buffer_size", "0"),
        ("dqn", "learning_starts", "-1"),
        ("dqn", "train_freq", "0"),
        ("dqn", "gradient_steps", "-1"),
        ("dqn", "target_update_interval", "0"),
        ("dqn", "tau", "1.1"),
        ("dqn", "exploration_fraction", "0"),
        ("dqn", "exploration_initial_eps", "2"),
        ("qrdqn", "exploration_final_eps", "-0.1"),
        ("trpo", "target_kl", "0"),
        ("trpo", "cg_max_steps", "0"),
        ("trpo", "cg_damping", "-0.1"),
        ("trpo", "sub_sampling_factor", "0"),
        ("trpo", "n_critic_updates", "2.5"),
    ],
)
def test_refuses_what_stable_baselines_would_take(algo: str, name: str, text: str) -> None:
    with pytest.raises((ValueError, TypeError), match=f"^{name} must be .*, not .*{text}"):
        zoo.hyperparameters(algo, "pp", {name: text})


def test_refuses_a_batch_that_does_not_divide_the_rollout() -> None:
    with pytest.raises(ValueError, match="n_steps must be a multiple of batch_size, which 256 is not of 100"):
        zoo.hyperparameters("ppo", "pp", {"batch_size": "100"})


@pytest.mark.parametrize("algo", ["oracle", "belief"])
def test_refuses_another_network_where_there_is_none_to_replace(algo: str) -> None:
    with pytest.raises(ValueError, match=f"^{algo} has no network that 'residual' could replace.$"):
        zoo.entry(f"{algo}+residual")


def test_refuses_unknown_names() -> None:
    with pytest.raises(ValueError, match="unknown algorithm 'vgp' .did you mean 'vpg'"):
        zoo.hyperparameters("vgp", "pp", {})
    with pytest.raises(ValueError, match="unknown algorithm 0"):
        zoo.entry(0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="allowed are 'vpg', 'vpg-tuned', .*, 'oracle'"):
        zoo.make("", Noise(), 0, {})
    with pytest.raises(ValueError, match="unknown preset of vpg 'spinupp' .did you mean 'spinup'"):
        zoo.hyperparameters("vpg", "pp", {}, preset="spinupp")
    with pytest.raises(ValueError, match="unknown hyperparameter of random 'gamma': allowed are none"):
        zoo.hyperparameters("random", "pp", {"gamma": "0.9"})


@pytest.mark.parametrize("seed", [-1, 2**32, 1.0, "0", True])
def test_refuses_seeds(seed: Any) -> None:
    with pytest.raises((ValueError, TypeError), match="seed must be a whole number"):
        zoo.make("random", Noise(), seed, {})


def test_make_vpg_from_the_table() -> None:
    model = zoo.make(
        "vpg", Noise(), 3, zoo.hyperparameters("vpg", "fp", {"n_steps": "8"}), device="cpu", verbose=0
    )
    assert isinstance(model, VPG)
    assert (model.seed, model.n_steps, model.gae_lambda) == (3, 8, 0.95)
    model.learn(16)
    assert model.num_timesteps == 16


def test_an_sb3_algorithm_is_one_more_row(monkeypatch: pytest.MonkeyPatch) -> None:
    row = zoo.Entry(
        cls="stable_baselines3:A2C",
        policy="MlpPolicy",
        hyperparameters={"n_steps": 8, "gamma": 0.9},
        policy_kwargs=zoo.TRUNK,
    )
    monkeypatch.setitem(zoo.ZOO, "mine", row)
    merged = zoo.hyperparameters("mine", "pp", {"gamma": "0.5"})
    model = zoo.make("mine", Noise(), 0, merged, device="cpu").learn(32)
    assert model.gamma == 0.5
    assert any(type(module).__name__ == "ConvTrunk" for module in model.policy.modules())


class ThreeSteps(stable_baselines3.DQN):
    """A class from outside that sets its returns itself."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, n_steps=3, **kwargs)


def rewards_of(model: Any) -> set[float]:
    """The returns that a model samples after four rewards of 1, 10, 100, 1000 in an endless episode."""
    image = np.zeros((1, 8, 8, 2), np.float32)
    for reward in (1, 10, 100, 1000):
        action, done = np.zeros(1, int), np.zeros(1)
        model.replay_buffer.add(image, image, action, np.array([reward]), done, [{}])
    return set(model.replay_buffer.sample(200).rewards.flatten().tolist())


def test_n_step_returns_of_a_class_from_outside_are_learned_from(monkeypatch: pytest.MonkeyPatch) -> None:
    place = "three:ThreeSteps"
    monkeypatch.setitem(sys.modules, "three", sys.modules[__name__])
    model = zoo.make(place, Noise(), 0, {}, device="cpu", gamma=0.25)
    assert rewards_of(model) == {1 + 2.5 + 6.25, 10 + 25 + 62.5, 100 + 250, 1000}
    model.learn(8)


def test_n_steps_of_returns_are_neither_shared_out_nor_multiples_of_a_batch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = replace(zoo.ZOO["dqn"], hyperparameters={"n_steps": 3, "batch_size": 32, "gamma": 0.5})
    monkeypatch.setattr(sys.modules[__name__], "ROW", row, raising=False)
    monkeypatch.setitem(sys.modules, "three", sys.modules[__name__])
    hyperparameters = zoo.hyperparameters("three:ROW", "pp")
    model = zoo.make("three:ROW", DummyVecEnv([Noise, Noise]), 0, hyperparameters, device="cpu")
    assert model.n_steps == model.replay_buffer.n_steps == 3


@pytest.mark.parametrize("n_envs", [1, 2, 4, 6])
def test_updates_per_step_are_the_same_for_any_number_of_environments(n_envs: int) -> None:
    small = {"learning_starts": 0, "train_freq": 4, "gradient_steps": 1, "batch_size": 4, "buffer_size": 96}
    hyperparameters = zoo.hyperparameters("dqn", "pp", small)
    model = zoo.make("dqn", DummyVecEnv([Noise] * n_envs), 0, hyperparameters, device="cpu")
    model.learn(96)
    assert model._n_updates == 96 / 4


def test_listing_the_table_does_not_import_torch() -> None:
    code = "import sys; from usbench.agents import zoo; zoo.entry('vpg'); print('torch' in sys.modules)"
    result = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout == "False\n"


@pytest.mark.parametrize("algo", ["random", "stay", "oracle"])
def test_not_learned_agents_take_no_step(algo: str) -> None:
    env = Noise()
    agent = zoo.make(algo, env, 0, {}, policy=Plan())
    assert agent.learn(1000, callback=None, progress_bar=False) is agent
    assert (env.steps, agent.num_timesteps) == (0, 0)
    assert not zoo.entry(algo).learns


def test_random_is_uniform_and_reproducible() -> None:
    agents = [zoo.make("random", Noise(), seed, {}) for seed in (4, 4, 5)]
    draws = [agent.predict(IMAGES, deterministic=True)[0] for agent in agents]
    np.testing.assert_array_equal(draws[0], draws[1])
    assert (draws[0] != draws[2]).any()
    counts = np.bincount(draws[0], minlength=5)
    # Expected 200 each, standard deviation 12.6.
    assert counts.shape == (5,)
    assert (abs(counts - 200) < 5 * 12.6).all()


def test_predict_has_sb3s_shapes() -> None:
    for agent in (Random(None, Noise(), 0), Stay(None, Noise())):
        actions, state = agent.predict(IMAGES[:3], state=None, episode_start=np.ones(3, bool))
        assert (actions.shape, actions.dtype, state) == ((3,), np.int64, None)
        single, _ = agent.predict(IMAGES[0])
        assert single.shape == ()
        assert 0 <= int(single) < 5
    assert Stay(None, Noise()).predict(IMAGES[:3])[0].tolist() == [0, 0, 0]


def test_oracle_follows_its_plan() -> None:
    agent = zoo.make("oracle", Noise(), 0, {}, policy=Plan())
    assert agent.sees_state
    info = {"x_mm": 5, "focal_depth_mm": 50, "angle_deg": 15, "step": 3, "distance_mm": 5.0}
    actions, _ = agent.predict([info, {**info, "step": 5}])
    assert actions.tolist() == [(3 + 70) % 5, (5 + 70) % 5]
    assert agent.predict(info)[0].shape == ()


def test_oracle_says_what_is_missing() -> None:
    agent = Oracle(Plan(), Noise())
    with pytest.raises(ValueError, match="step, angle_deg is missing"):
        agent.predict([{"x_mm": 5, "focal_depth_mm": 50}])
    with pytest.raises(TypeError, match="the oracle's policy must have a method action"):
        zoo.make("oracle", Noise(), 0, {})


def test_refuses_continuous_actions() -> None:
    env = Noise()
    env.action_space = gym.spaces.Box(-1, 1, (2,), np.float32)
    with pytest.raises(ValueError, match="the actions must be Discrete"):
        Random(None, env)


def test_saved_agents_go_on_where_they_were(tmp_path: Path) -> None:
    agent = Random(None, Noise(), 4)
    agent.predict(IMAGES)
    agent.save(tmp_path / "a")
    agent.save(tmp_path / "b.zip")
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    loaded = Random.load(tmp_path / "a", env=Noise())
    np.testing.assert_array_equal(loaded.predict(IMAGES)[0], agent.predict(IMAGES)[0])
    Oracle(Plan(), Noise()).save(tmp_path / "oracle.zip")
    assert Oracle.load(tmp_path / "oracle.zip", Noise(), policy=Plan()).sees_state


def test_every_hyperparameter_in_the_table_has_a_range() -> None:
    assert {
        name for row in zoo.ZOO.values() for name in (*row.hyperparameters, *row.options)
    } <= RANGES.keys()
