"""Which configuration of an algorithm keeps the algorithm's name."""

import json
from pathlib import Path

import pytest
from made_tables import made, seeds, trial

from usbench.agents import zoo
from usbench.results import agents, tables, verdict
from usbench.results.protocol import further

GRID = Path(__file__).parents[2] / "leaderboard_files"


def other(score=0.7, gamma=0.9, **changes):
    """A trial of `vpg` with another discount."""
    settings = json.dumps({"environment": "e", "gamma": gamma})
    return trial("vpg", score, settings=settings, configuration="00000002", **changes)


def names(*trials):
    return list(agents.named(made(*trials).trials)["agent"])


def test_one_configuration_needs_no_other_name():
    assert names(trial("vpg"), trial("ppo"), trial("vpg", task="pp")) == ["vpg", "ppo", "vpg"]


def test_the_one_that_fills_most_cells_keeps_the_name_even_where_the_other_has_more_trials():
    grid = [*seeds("vpg", [0.5, 0.6]), *seeds("vpg", [0.5, 0.6], task="pp")]
    assert names(*grid, *(other(seed=seed) for seed in range(5))) == ["vpg"] * 4 + ["vpg gamma=0.9"] * 5


def test_the_one_with_most_trials_keeps_the_name_where_both_fill_the_same_cells():
    assert names(*seeds("vpg", [0.5, 0.6]), other()) == ["vpg", "vpg", "vpg gamma=0.9"]
    assert names(trial("vpg"), other(), other(seed=1)) == ["vpg gamma=0.99", "vpg", "vpg"]


def test_unfinished_trials_fill_nothing():
    assert names(trial("vpg"), other(status="failed"), other(seed=1, status="missing"))[0] == "vpg"


def test_of_equals_none_keeps_the_name():
    assert names(trial("vpg"), other()) == ["vpg gamma=0.99", "vpg gamma=0.9"]


def own(**changes):
    """A trial of `vpg` with the settings of the table of algorithms."""
    settings = json.dumps({"environment": "e", **zoo.hyperparameters("vpg", "fp")})
    return trial("vpg", settings=settings, **changes)


@pytest.mark.parametrize("n_steps", ["x", [1], None])
def test_a_rollout_that_is_no_number_is_not_the_commands_own(n_steps):
    settings = json.dumps({"environment": "e", **zoo.hyperparameters("vpg", "fp"), "n_steps": n_steps})
    row = made(trial("vpg", settings=settings)).trials.iloc[0]
    assert not agents.has_envs(row)


@pytest.mark.parametrize("n", [3, 4, 11])
def test_the_settings_of_the_table_of_algorithms_keep_the_name_however_many_trials_others_have(n):
    found = names(*(own(seed=seed) for seed in range(3)), *(other(seed=seed) for seed in range(n)))
    assert found[:3] == ["vpg"] * 3 and not {"vpg"} & {*found[3:]}


@pytest.mark.parametrize(
    ("changed", "said"), [({"n_envs": 16}, "n_envs=16"), ({"senses": "heading"}, "senses=heading")]
)
@pytest.mark.parametrize("n", [3, 4, 11])
def test_other_environments_and_senses_do_not_take_the_name(changed, said, n):
    settings = json.dumps(json.loads(own()["settings"]) | changed)
    others = [own(seed=seed) | {"settings": settings, "configuration": "00000006"} for seed in range(n)]
    assert names(*(own(seed=seed) for seed in range(3)), *others) == ["vpg"] * 3 + [f"vpg {said}"] * n


def test_an_algorithm_with_many_environments_of_its_own_is_usual_with_them():
    settings = zoo.hyperparameters("double_dqn", "pp-random")
    many, one = (
        trial("double_dqn", task="pp-random", steps=100_000, settings=json.dumps(settings | {"n_envs": n}))
        for n in (zoo.entry("double_dqn").n_envs, 1)
    )
    assert [agents.has_envs(row) for row in (many, one)] == [True, False]


def test_an_unfinished_trial_is_in_the_row_of_its_configuration_though_nobody_knows_whether_it_explores():
    done = json.dumps({"environment": "e", "explores": True})
    rows = [trial("mine:DQN", seed=seed, settings=done) for seed in range(3)]
    waits = trial("mine:DQN", seed=3, settings='{"environment": "e"}', status="missing")
    assert names(*rows, waits) == ["mine:DQN"] * 4


def test_trials_with_less_than_the_budget_do_not_take_the_name():
    short = [own(seed=seed, steps=640, configuration="00000002") for seed in range(4)]
    assert names(own(), *short) == ["vpg"] + ["vpg steps=640"] * 4


def test_every_trial_of_the_grid_has_the_settings_of_the_table_of_algorithms():
    """So that no other trial can take the name of one of its rows."""
    trials = further.first(tables.read(GRID)).trials
    learned = trials[trials["steps"] > 0]
    assert len(learned) and learned.apply(agents.is_usual, axis=1).all()


def test_many_settings_are_a_digest_and_steps_are_one_of_them():
    settings = {"environment": "e", "gamma": 0.9, "learning_rate": 1e-3, "n_steps": 16}
    many = trial("vpg", settings=json.dumps(settings), configuration="00000002")
    short = trial("vpg", steps=64, configuration="00000003")
    found = names(*seeds("vpg", [0.5, 0.6]), many, short)
    assert found[3] == "vpg steps=64"
    assert len(found[2]) == len("vpg 01234567") and "=" not in found[2]


@pytest.mark.parametrize(
    ("changed", "said"), [({"n_envs": 16}, "vpg n_envs=1"), ({"senses": "heading"}, "vpg senses=none")]
)
def test_what_a_row_leaves_out_has_its_value_in_a_name(changed, said):
    settings = json.dumps(json.loads(trial("vpg")["settings"]) | changed)
    most = [trial("vpg", noise=noise, settings=settings, configuration="00000004") for noise in (0.0, 0.5)]
    assert names(*most, trial("vpg")) == ["vpg", "vpg", said]


def test_an_option_that_a_trial_does_not_say_has_its_default():
    plain = trial("double_dqn")
    greedy = json.dumps(json.loads(plain["settings"]) | {"greedy_shift_px": 2})
    other = trial("double_dqn", settings=greedy, configuration="00000004")
    assert names(plain, plain, other) == [*["double_dqn"] * 2, "double_dqn greedy_shift_px=2"]
    assert names(plain, other, other) == ["double_dqn greedy_shift_px=0", *["double_dqn"] * 2]


def test_other_settings_with_another_noise_are_a_row_of_their_own_too():
    mixed = [trial("vpg"), trial("vpg", noise=0.25), trial("vpg", task="pp"), other(noise=0.5)]
    assert names(*mixed) == ["vpg", "vpg", "vpg", "vpg gamma=0.9"]


def test_settings_of_another_task_are_its_own():
    assert names(trial("vpg"), trial("vpg", noise=0.25), other(task="pp")) == ["vpg"] * 3


def test_papers_tasks_count_apart():
    exam = [other(task="exam"), other(task="exam", seed=1), trial("vpg", task="exam")]
    assert names(*seeds("vpg", [0.5, 0.6]), other(), *exam) == [
        *("vpg", "vpg", "vpg gamma=0.9"),
        *("vpg", "vpg", "vpg gamma=0.99"),
    ]


def test_a_single_trial_with_other_settings_leaves_the_papers_agent_in_the_verdict():
    grid = [*seeds("vpg", [0.5, 0.51, 0.52]), *seeds("ppo", [0.9, 0.91, 0.92])]
    text = verdict.text(made(*grid, other(trial="mine")))
    assert "`vpg`" in text and "lacks finished trials" not in text


@pytest.mark.parametrize("steps", [16_064, 32_128])
def test_a_buffer_that_holds_the_whole_budget_is_the_tables(steps):
    """`resolve` fills it in so; trials with the table's settings keep the name, however many others are."""
    task = "fp" if steps == 16_064 else "exam"
    row = zoo.ZOO["dqn"]
    own = {**row.hyperparameters, **row.tasks.get(task, {})}
    own = {"environment": "e", **own, "buffer_size": max(own["buffer_size"], steps)}
    rows = [
        trial(
            "dqn", seed=seed, task=task, steps=steps, settings=json.dumps(own | changed), configuration=name
        )
        for seed, (changed, name) in enumerate([({}, "1"), ({"gamma": 0.5}, "2"), ({"gamma": 0.5}, "2")])
    ]
    assert names(*rows) == ["dqn", "dqn gamma=0.5", "dqn gamma=0.5"]
