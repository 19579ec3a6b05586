"""RF of input at its borders, and of bad input."""

import math
import re
import reprlib
from fractions import Fraction

import numpy as np
import pytest
from echoes import ARRAY, CLOUD, SMALL, WEIGHTS

from usbench.envs.field import response_table
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf


def test_nothing_there_is_silence():
    rf, time = simulate_rf(np.empty((0, 3)), np.empty(0), ARRAY, 50e-3)
    assert rf.shape == (len(time), 64) and not rf.any()
    assert simulate_rf([], [], ARRAY, 50e-3)[0].shape[1] == 64


def test_a_silent_scatterer_is_silence():
    assert not simulate_rf([(0, 0, 50e-3)], [0.0], ARRAY, 50e-3)[0].any()


@pytest.mark.parametrize("depth", [0.0, -1e-3])
def test_refuses_scatterers_not_below_the_surface(depth):
    with pytest.raises(ValueError, match=r"^scatterers must lie below the surface \(z > 0\), not at z = "):
        simulate_rf([(0, 0, 50e-3), (0, 0, depth)], [1.0, 1.0], ARRAY, 50e-3)


@pytest.mark.parametrize("depth", [1e-6, 0.1e-3, 0.6e-3])
def test_scatterers_just_below_the_surface_are_harmless(depth):
    scene = [(0, 0, depth)], [1.0], LinearArray(**SMALL), 50e-3, [0.0]
    rf, time = simulate_rf(*scene)
    assert np.linalg.norm(rf) == pytest.approx(np.linalg.norm(slow_rf(*scene, time=time)[0]), rel=0.01)


@pytest.mark.parametrize("depth", [1e-6, 0.1e-3, 0.6e-3])
def test_a_table_is_harmless_there_though_it_holds_from_a_millimetre_on(depth, with_table):
    scene = [(0, 0, depth)], [1.0], LinearArray(**SMALL), 50e-3, [0.0]
    rf, time = simulate_rf(*scene)
    assert np.linalg.norm(rf) == pytest.approx(np.linalg.norm(slow_rf(*scene, time=time)[0]), rel=0.3)


def test_refuses_a_focal_depth_in_mm():
    with pytest.raises(ValueError, match=r"focal_depth must .*, not 30: did you mean 0.03 \(30 mm\)\?$"):
        simulate_rf([(0, 0, 50e-3)], [1.0], ARRAY, 30)


@pytest.mark.parametrize("focal_depth", [0, -0.01, math.nan, math.inf, 0.51, Fraction(51, 100), 10**400])
def test_refuses_focal_depths(focal_depth):
    with pytest.raises(ValueError) as refused:
        simulate_rf([(0, 0, 50e-3)], [1.0], ARRAY, focal_depth)
    assert str(refused.value) == f"focal_depth must be in (0, 0.5] m, not {reprlib.repr(focal_depth)}."


@pytest.mark.parametrize("max_depth", [0, -0.1, math.nan, 90])
def test_refuses_where_lines_cannot_end(max_depth):
    with pytest.raises(ValueError, match=rf"^max_depth must be in \(0, 0.5\] m, not {max_depth}"):
        simulate_iq([(0, 0, 50e-3)], [1.0], ARRAY, 50e-3, max_depth=max_depth)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_refuses_values_that_are_not_finite(value):
    for positions, amplitudes, lines, name in [
        ([(value, 0, 50e-3)], [1.0], [0.0], "positions"),
        ([(0, 0, 50e-3)], [value], [0.0], "amplitudes"),
        ([(0, 0, 50e-3)], [1.0], [value], "line_positions"),
    ]:
        with pytest.raises(ValueError, match=f"^{name} must be finite"):
            simulate_rf(positions, amplitudes, ARRAY, 50e-3, lines)


@pytest.mark.parametrize(
    "positions, amplitudes, lines, words",
    [
        ([(0, 0.05)], [1.0], [0.0], r"positions must have shape \(n, 3\), not \(1, 2\)"),
        ([0, 0, 0.05], [1.0], [0.0], r"positions must have shape \(n, 3\), not \(3,\)"),
        ([(0, 0, 0.05)], [1.0, 2.0], [0.0], r"amplitudes must have shape \(1,\)"),
        ([(0, 0, 0.05)], 1.0, [0.0], r"amplitudes must have shape \(1,\)"),
        ([(0, 0, 0.05)], [1.0], [], r"line_positions must have shape \(n_lines,\)"),
        ([(0, 0, 0.05)], [1.0], [[0.0]], r"line_positions must have shape \(n_lines,\)"),
        (
            [(0, 0, 50.0)],
            [1.0],
            [0.0],
            r"positions must be .* m, not 50 m: did you mean 0.05 \(50 mm\)",
        ),
        ([(0, 0, 0.05)], [1.0], [2.0], r"line_positions must be within 0.5 m, not 2 m"),
    ],
)
def test_refuses_shapes_and_units(positions, amplitudes, lines, words):
    with pytest.raises(ValueError, match=words):
        simulate_rf(positions, amplitudes, ARRAY, 50e-3, lines)


@pytest.mark.parametrize(("position", "kind"), [(0, "positions"), (1, "amplitudes"), (4, "line_positions")])
@pytest.mark.parametrize("change, dtype", [(complex, "complex128"), (str, "<U32"), (object, "object")])
def test_refuses_arrays_of_other_things_than_real_numbers(position, kind, change, dtype):
    arguments = [[(0.0, 0.0, 50e-3)], [1.0], ARRAY, 50e-3, [0.0]]
    arguments[position] = np.array(arguments[position]).astype(change)
    with pytest.raises(ValueError, match=f"^{kind} must be real numbers, not {dtype}.$"):
        simulate_rf(*arguments)


@pytest.mark.parametrize("value", ["0.03", None, True, 0.03j])
def test_refuses_scalars_that_are_no_numbers(value):
    with pytest.raises(TypeError, match=rf"^focal_depth must be a number in \(0, 0.5\], not {value!r}\.$"):
        simulate_rf([(0, 0, 50e-3)], [1.0], ARRAY, value)
    said = f"attenuation_db_per_cm_mhz must be a non-negative number, not {value!r}."
    with pytest.raises(TypeError, match=f"^{re.escape(said)}$"):
        simulate_rf([(0, 0, 50e-3)], [1.0], ARRAY, 50e-3, attenuation_db_per_cm_mhz=value)


@pytest.mark.parametrize("name", ["focal_depth", "attenuation_db_per_cm_mhz", "max_depth"])
def test_a_number_of_32_bits_is_taken_as_its_float(name, with_table, monkeypatch, tmp_path):
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path))
    narrow = np.float32(0.05)
    found, kept = [], []
    for value in (float(narrow), narrow):
        response_table.forget_tables()
        arguments = {"focal_depth": 0.05, name: value}
        found.append(simulate_iq(CLOUD, WEIGHTS, LinearArray(**SMALL), **arguments)[0])
        kept.append(sorted(path.name for path in tmp_path.rglob("*") if path.is_file()))
    assert found[0].tobytes() == found[1].tobytes() and kept[0] == kept[1]


@pytest.mark.parametrize("amplitude", [1e31, -1e39])
def test_refuses_amplitudes_that_single_precision_cannot_add_up(amplitude):
    said = re.escape(f"amplitude of scatterer 2 must be a number in [-1e+30, 1e+30], not {amplitude!r}.")
    with pytest.raises(ValueError, match=f"^{said}$"):
        simulate_rf([(0, 0, 0.03), (0, 0, 0.05)], [1.0, amplitude], LinearArray(**SMALL), 0.05)
