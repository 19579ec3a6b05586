"""What takes long says what it is and how long it takes: the library through logging, commands at once."""

import logging
import re

import numpy as np
import pytest

from usbench import cli, waiting
from usbench.envs.field.elevation import elevation_taps
from usbench.envs.field.response_table import forget_tables
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq

# Of any length, since machines differ.
TIME = r"(less than 10 s|about [\d.]+ (s|min|h))\."
SMALL = LinearArray(n_elements=24, n_active=8, n_lines=4, line_spacing=0.5e-3)


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test turns forward, in place of the machine's."""
    now = [0.0]
    monkeypatch.setattr(waiting.time, "perf_counter", lambda: now[0])
    return now


def told(caplog):
    return [record.message for record in caplog.records if record.name == "usbench.waiting"]


def test_long_work_is_told_once_with_an_estimate_of_the_whole(clock, caplog):
    caplog.set_level(logging.INFO)
    work = waiting.Waiting("Adding up", 40, at_once=2)
    for _ in range(6):
        clock[0] += 0.5
        work.done()
    assert told(caplog) == ["Adding up: about 20 s."]  # after two parts and 1 s


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (3, "less than 10 s"),
        (12, "about 10 s"),
        (44, "about 40 s"),
        (170, "about 3 min"),
        (9100, "about 2.5 h"),
    ],
)
def test_times_are_told_in_seconds_minutes_or_hours(seconds, said, caplog):
    caplog.set_level(logging.INFO)
    waiting.announce("Adding up", seconds)
    assert told(caplog) == [f"Adding up: {said}."]


@pytest.mark.parametrize(("n_parts", "step"), [(40, 0.01), (3, 0.5), (1, 5.0)])
def test_short_work_and_what_is_over_at_once_is_not_told(clock, caplog, n_parts, step):
    caplog.set_level(logging.INFO)
    work = waiting.Waiting("Adding up", n_parts)
    for _ in range(n_parts):
        clock[0] += step
        work.done()
    assert told(caplog) == []


@pytest.fixture
def impatient(monkeypatch):
    """Everything is long."""
    monkeypatch.setattr(waiting, "LONG_S", 0.0)
    monkeypatch.setattr(waiting, "_MEASURED_S", 0.0)
    forget_tables()
    elevation_taps.cache_clear()


def test_the_library_tells_of_filters_tables_and_sums(impatient, caplog, tmp_path, monkeypatch):
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path))
    caplog.set_level(logging.INFO)
    rng = np.random.default_rng(0)
    points = rng.uniform([-2e-3, -1e-3, 5e-3], [2e-3, 1e-3, 20e-3], (600, 3))
    simulate_iq(points, np.ones(600), SMALL, 0.0123)
    filters, table, summing = told(caplog)
    assert re.fullmatch(f"Fitting the filters of a probe's height: {TIME}", filters)
    assert re.fullmatch(f".* responses at 3.5 MHz for the focal depth 12.3 mm: {TIME}", table)
    assert re.fullmatch(f"Summing 600 scatterers for 4 lines: {TIME}", summing)
    caplog.clear()
    simulate_iq(points[:200], np.ones(200), SMALL, 0.0123, [5e-3])
    assert [text.partition(":")[0] for text in told(caplog)] == [
        "Summing 200 scatterers directly for 1 lines"
    ]


def test_a_command_writes_it_to_the_standard_error(impatient, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path))
    assert cli.main(["frame", "--depth", "33", "--out", str(tmp_path / "frame.png")]) == 0
    assert re.search(f"for the focal depth 33 mm: {TIME}", capsys.readouterr().err)
    assert not logging.getLogger("usbench.waiting").handlers
