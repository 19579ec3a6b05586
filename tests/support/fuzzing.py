"""What tests with generated input share: strategies, and the count of the inputs that were tried."""

import os
from collections import Counter

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from usbench.agents import zoo

TRIED = Counter()
fuzz = settings(
    max_examples=int(os.environ.get("USBENCH_FUZZ", "100")),
    deadline=None,
    database=None,
    # The same examples every time, so that a test fails for what was changed; others where more are wanted.
    derandomize="USBENCH_FUZZ" not in os.environ,
    # Fixtures are made once for all examples: each example leaves them as it found them.
    suppress_health_check=list(HealthCheck),
)

NUMBERS = st.one_of(
    st.integers(),
    st.floats(),
    st.sampled_from(
        [0, 1, -1, 4, 16, 0.25, 2**31, 2**32, 2**63, 1e300, 1e-300, True, np.int64(3), np.float32(0.5)]
    ),
)
ANYTHING = st.one_of(
    NUMBERS,
    st.text(max_size=12),
    st.sampled_from([None, b"", {}, 1j, object()]),
    st.lists(NUMBERS, max_size=2),
)
NAMES = st.sampled_from(
    [*zoo.ZOO, "fp", "pp", "spinup", "os:system", "a:b:c", ":", "x_mm", "gamma", "n_steps"]
)
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), NAMES),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=6,
)


def report(request):
    """The fixture of a module with generated input: it reports how many inputs were tried."""
    TRIED.clear()
    yield
    terminal, capture = (
        request.config.pluginmanager.getplugin(name) for name in ("terminalreporter", "capturemanager")
    )
    if terminal is not None:  # none in the workers of pytest-xdist
        parts = [f"{kind} {number}" for kind, number in sorted(TRIED.items())]
        with capture.global_and_fixture_disabled():
            terminal.write_line(f"\n{TRIED.total()} inputs tried: {', '.join(parts)}")


def one_sentence(text):
    return bool(text) and "\n" not in text and "Traceback" not in text


def tried(kind, call, *refusals):
    """Call, and check that a refusal is one sentence; return the result, or None where it was refused."""
    try:
        result = call()
    except refusals as error:
        assert one_sentence(str(error)), repr(error)
        TRIED[f"{kind}, refused:"] += 1
        return None
    TRIED[f"{kind}, handled:"] += 1
    return result
