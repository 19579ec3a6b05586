"""How agents and noises are drawn: known names by a table, others by a rule that no neighbour changes."""

import pytest
from matplotlib.markers import MarkerStyle

from usbench.agents import zoo
from usbench.figures import looks


def test_every_algorithm_of_the_package_has_a_row():
    assert set(zoo.UNSEARCHED) <= set(looks.KNOWN)


def test_learning_agents_differ_in_colour_and_in_marker():
    learning = [look for name, look in looks.KNOWN.items() if name not in ("oracle", "random", "stay")]
    for key in ("color", "marker"):
        assert len({look[key] for look in learning}) == len(learning)


@pytest.mark.parametrize("name", ["mine", "vpg gamma=0.9", "human + advice", "é"])
def test_a_name_is_drawn_alike_whatever_stands_beside_it(name):
    alone = looks.agents([name])[name]
    assert looks.agents([name, *looks.KNOWN, "zzz"])[name] == alone


def test_a_variant_has_the_colour_of_its_algorithm_and_another_marker():
    drawn = looks.agents(["vpg", "vpg gamma=0.9"])
    assert drawn["vpg gamma=0.9"]["color"] == drawn["vpg"]["color"]
    assert drawn["vpg gamma=0.9"]["marker"] != drawn["vpg"]["marker"]


VARIANTS = ["a2c ent_coef=0.01", "a2c learning_rate=0.0001", "a2c learning_rate=0.0001, n_steps=64"]


@pytest.mark.parametrize(
    "names",
    [
        ["vpg", "vpg gamma=0.95", "vpg gamma=0.95, initial_value=-26.0"],
        ["double_dqn", "double_dqn max_shift_px=2"],
        ["a2c", *VARIANTS],
        VARIANTS,
        ["ppo", "ppo+residual"],
    ],
)
def test_variants_of_an_algorithm_differ_in_line_and_in_a_filled_marker(names):
    drawn = [looks.KNOWN[names[0].split()[0]], *looks.agents(names).values()]
    drawn = [look for place, look in enumerate(drawn) if look not in drawn[:place]]
    assert len({look["color"] for look in drawn}) == 1
    for key in ("linestyle", "marker"):
        assert len({str(look[key]) for look in drawn}) == len(drawn)
    assert all(MarkerStyle(look["marker"]).is_filled() for look in drawn)


def test_a_further_network_looks_like_its_algorithm_where_that_does_not_stand_beside_it():
    drawn = looks.agents(["ppo+residual", "vpg+residual", "vpg+residual gamma=0.9"])
    assert drawn["ppo+residual"] == looks.KNOWN["ppo"] and drawn["vpg+residual"] == looks.KNOWN["vpg"]
    assert drawn["vpg+residual gamma=0.9"]["marker"] != looks.KNOWN["vpg"]["marker"]


def test_those_of_one_colour_have_their_markers_in_turn():
    drawn = looks.agents(["a2c", "ppo", "ppo gamma=0.9"])
    assert looks.turns(drawn) == {"a2c": (0, 1), "ppo": (0, 2), "ppo gamma=0.9": (1, 2)}


def test_more_names_than_colours_differ_all_the_same():
    drawn = looks.agents(f"agent{k}" for k in range(60))
    assert len({str(look) for look in drawn.values()}) == 60


def test_noises_share_no_colour_with_an_agent_and_get_lighter():
    drawn = [looks.noise(p) for p in (0.0, 0.25, 0.5)]
    for key in ("color", "marker", "linestyle"):
        assert len({look[key] for look in drawn}) == 3
    assert not {look["color"] for look in drawn} & {look["color"] for look in looks.KNOWN.values()}
    brightness = [sum(bytes.fromhex(look["color"][1:])) for look in drawn]
    assert brightness == sorted(brightness)
