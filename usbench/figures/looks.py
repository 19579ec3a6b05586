"""How each agent and each noise is drawn: alike in every figure, and told apart in grey too."""

from collections.abc import Iterable, Mapping
from typing import Any
from zlib import crc32

from matplotlib import colormaps
from matplotlib.colors import to_hex

from usbench.words import network_apart

Look = dict[str, Any]

LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 2, 4, 2)))
# Of them, those that are told apart at a glance, and come first.
N_PLAIN = 4
# Okabe and Ito's palette without its yellow, and five of Tol's: a colour and a marker belong to one agent.
KNOWN: dict[str, Look] = {
    "vpg": {"color": "#000000", "marker": "X", "linestyle": "-"},
    "vpg-tuned": {"color": "#999933", "marker": "d", "linestyle": "--"},
    "a2c": {"color": "#0072b2", "marker": "o", "linestyle": "-"},
    "ppo": {"color": "#009e73", "marker": "P", "linestyle": "-."},
    "recurrent_ppo": {"color": "#56b4e9", "marker": "v", "linestyle": LINES[6]},
    "trpo": {"color": "#882255", "marker": "h", "linestyle": LINES[4]},
    "dqn": {"color": "#d55e00", "marker": "s", "linestyle": "--"},
    "double_dqn": {"color": "#e69f00", "marker": "D", "linestyle": LINES[5]},
    "qrdqn": {"color": "#cc79a7", "marker": "^", "linestyle": ":"},
    "ppo_asymmetric": {"color": "#117733", "marker": "p", "linestyle": "--"},
    "distilled": {"color": "#332288", "marker": "<", "linestyle": "-"},
    "belief": {"color": "#661100", "marker": ">", "linestyle": ":"},
    # Agents that do not learn.
    "oracle": {"color": "0.5", "marker": "*", "linestyle": "--"},
    "random": {"color": "0.5", "marker": "x", "linestyle": ":"},
    "stay": {"color": "0.5", "marker": "_", "linestyle": ":"},
}
# For names that the table does not have: others of Tol's colours, and filled markers that no row above has.
# By their corners: an upright bar, one that leans to the right, one that leans to the left, and a cup.
OTHER_COLORS = ("#44aa99", "#6699cc", "#aa4466")
OTHER_MARKERS = (
    ((-0.6, -1), (0.6, -1), (0.6, 1), (-0.6, 1), (-0.6, -1)),
    ((-1, -1), (0.3, -1), (1, 1), (-0.3, 1), (-1, -1)),
    ((-0.3, -1), (1, -1), (0.3, 1), (-1, 1), (-0.3, -1)),
    ((-0.4, -1), (0.4, -1), (1, 1), (-1, 1), (-0.4, -1)),
)
NOISE_MARKERS = ("o", "s", "D", "^", "v")


def agents(names: Iterable[str]) -> dict[str, Look]:
    """Return how each agent is drawn, as keyword arguments of matplotlib, names in order.

    A name of the table is drawn as the table says, and so is one with another network ("ppo+residual") where
    that name does not stand beside it. Another name follows from its letters alone, so that it is drawn alike
    whatever stands beside it; of two names that would look the same, the later one moves on. A variant
    ("ppo gamma=0.9") has its algorithm's colour, and as long as there are some, a line and a marker that
    neither the algorithm nor a variant before it has.
    """
    found: dict[str, Look] = {}
    for name in sorted(set(names)):
        found[name] = KNOWN[name] if name in KNOWN else _other(name, list(found.values()))
    return found


def turns(drawn: Mapping[str, Look]) -> dict[str, tuple[int, int]]:
    """Return the place of each agent among those of its colour, from 0, and how many these are.

    Curves of one colour that have their markers in turn are told apart even where they cover each other.
    """
    colors = [look["color"] for look in drawn.values()]
    return {
        name: (colors[:number].count(colors[number]), colors.count(colors[number]))
        for number, name in enumerate(drawn)
    }


def noise(p: float) -> Look:
    """Return how a probability of displacement is drawn: dark purple for none, lighter for more."""
    quarter = round(4 * p)
    return {
        "color": to_hex(colormaps["Purples"](max(1.0 - 0.9 * p, 0.35))),
        "marker": NOISE_MARKERS[quarter % len(NOISE_MARKERS)],
        "linestyle": LINES[quarter % len(LINES)],
    }


def _other(name: str, taken: list[Look]) -> Look:
    algo, *settings = name.split()
    plain, network = network_apart(algo)
    base = KNOWN.get(plain)
    looks = _looks(crc32(name.encode()), (base["color"],) if base else OTHER_COLORS)
    if base is None:
        return next((look for look in looks if look not in taken), looks[0])
    if network and not settings and base not in taken:
        return base
    beside = [base, *(look for look in taken if look["color"] == base["color"])]
    return min(looks, key=lambda look: _alike(look, beside))


def _looks(number: int, colors: tuple[str, ...]) -> list[Look]:
    """Return all looks of some colours, those with plain lines first, from one on that a number tells."""
    found = []
    for lines in (LINES[:N_PLAIN], LINES[N_PLAIN:]):
        looks = [
            {"color": color, "marker": marker, "linestyle": line}
            for line in lines
            for color in colors
            for marker in OTHER_MARKERS
        ]
        first = number % len(looks)
        found += [*looks[first:], *looks[:first]]
    return found


def _alike(look: Look, others: list[Look]) -> tuple[bool, bool, bool]:
    """Return whether a look is one of others, whether one of these has its line, and whether its marker."""
    return (
        look in others,
        any(other["linestyle"] == look["linestyle"] for other in others),
        any(other["marker"] == look["marker"] for other in others),
    )
