"""How each agent and each noise is drawn: alike in every figure, and told apart in grey too."""

from collections.abc import Iterable
from typing import Any
from zlib import crc32

from matplotlib import colormaps
from matplotlib.colors import to_hex

Look = dict[str, Any]

LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 2, 4, 2)))
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
# For names that the table does not have: others of Tol's colours, and markers that no row above has.
OTHER_COLORS = ("#44aa99", "#6699cc", "#aa4466")
OTHER_MARKERS = ("8", "H", "1", "2")
NOISE_MARKERS = ("o", "s", "D", "^", "v")


def agents(names: Iterable[str]) -> dict[str, Look]:
    """Return how each agent is drawn, as keyword arguments of matplotlib, names in order.

    A name of the table is drawn as the table says. Another name follows from its letters alone, so that it is
    drawn alike whatever stands beside it; of two names that would look the same, the later one moves on. A
    variant ("ppo gamma=0.9", "ppo+residual") has its algorithm's colour.
    """
    found: dict[str, Look] = {}
    for name in sorted(set(names)):
        found[name] = KNOWN[name] if name in KNOWN else _other(name, list(found.values()))
    return found


def noise(p: float) -> Look:
    """Return how a probability of displacement is drawn: dark purple for none, lighter for more."""
    quarter = round(4 * p)
    return {
        "color": to_hex(colormaps["Purples"](max(1.0 - 0.9 * p, 0.35))),
        "marker": NOISE_MARKERS[quarter % len(NOISE_MARKERS)],
        "linestyle": LINES[quarter % len(LINES)],
    }


def _other(name: str, taken: list[Look]) -> Look:
    algo, *_ = name.split()
    base = KNOWN.get(algo.partition("+")[0])
    colors = (base["color"],) if base else OTHER_COLORS
    n_looks = len(colors) * len(OTHER_MARKERS) * len(LINES)
    first = crc32(name.encode())
    tried = (_look(first + number, colors) for number in range(n_looks))
    return next((look for look in tried if look not in taken), _look(first, colors))


def _look(number: int, colors: tuple[str, ...]) -> Look:
    """Return the look of a number: neighbours differ in marker, then in colour, then in line."""
    rest, marker = divmod(number, len(OTHER_MARKERS))
    line, color = divmod(rest, len(colors))
    return {
        "color": colors[color],
        "marker": OTHER_MARKERS[marker],
        "linestyle": LINES[line % len(LINES)],
    }
