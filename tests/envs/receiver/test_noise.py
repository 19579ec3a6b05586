"""Noise of the electronics: its distribution and its level against theory, and that a seed makes it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from usbench.envs.anatomy.points import PointScatterers
from usbench.envs.bmode import Imaging, envelope
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.receiver.noise import noise, reference_amplitude, seed
from usbench.envs.rf import simulate_rf
from usbench.envs.scanner import acquire, scan, scan_batch
from usbench.envs.settings import Setup

ARRAY, TISSUE, POSE = LinearArray(), Phantom(), Pose()
NOISY = Imaging(noise_db=50)
EMPTY = Phantom(tissue_density_per_mm3=0.0, object_density_per_mm3=0.0)


@pytest.fixture(scope="module")
def sample():
    return noise((1000, 64), 50.0, ARRAY, TISSUE, POSE)


def test_its_envelope_is_rayleigh_distributed(sample):
    assert sample.dtype == np.complex64 and sample.shape == (1000, 64)
    sigma = reference_amplitude(ARRAY) * 10 ** (-50 / 20)
    assert np.sqrt(np.mean(np.abs(sample) ** 2)) == pytest.approx(sigma, rel=0.01)
    flat = np.abs(sample).ravel()
    assert stats.kstest(flat, stats.rayleigh(scale=sigma / np.sqrt(2)).cdf).pvalue > 0.01
    assert flat.mean() / flat.std() == pytest.approx(np.sqrt(np.pi / (4 - np.pi)), rel=0.02)  # 1.91
    assert stats.kstest(np.angle(sample).ravel(), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01


def test_it_is_white_over_samples_and_independent_between_lines(sample):
    power = np.mean(np.abs(sample) ** 2)
    for shift, axis in ((1, 0), (2, 0), (7, 0), (1, 1), (5, 1)):
        product = np.mean(sample * np.roll(sample, shift, axis).conj()) / power
        assert abs(product) < 4 / np.sqrt(sample.size)
    assert abs(np.mean(sample.real * sample.imag)) / power < 4 / np.sqrt(sample.size)
    spectrum = np.mean(np.abs(np.fft.fft(sample, axis=0)) ** 2, axis=1).reshape(20, 50).mean(axis=1)
    assert spectrum / spectrum.mean() == pytest.approx(np.ones(20), abs=0.1)


@pytest.mark.parametrize("frequency", [2e6, 3.5e6, 5e6])
def test_the_reference_is_the_echo_of_a_unit_point_at_the_focus(frequency):
    array = replace(ARRAY, center_frequency=frequency)
    rf, _ = simulate_rf([(0, 0, 50e-3)], [1.0], array, 50e-3, [0.0])
    assert reference_amplitude(array) == pytest.approx(envelope(rf).max(), rel=0.02)


def test_the_reference_stands_in_the_middle_of_its_aperture():
    # Half a pitch beside the middle of the array where the aperture has an odd number of elements. All are in
    # phase in the focus, and n Hann weights have the sum (n + 1) / 2, which counts both ways.
    odd, even = (reference_amplitude(LinearArray(n_active=n)) for n in (65, 64))
    assert odd / even == pytest.approx((66 / 65) ** 2, rel=3e-3)


@pytest.mark.parametrize(
    "phantom", [TISSUE, EMPTY, Phantom(tissue_amplitude_std=9.0, attenuation_db_per_cm_mhz=0.7)]
)
@pytest.mark.parametrize("pose", [POSE, Pose(0, 90, 0)])
def test_its_level_follows_neither_tissue_nor_focus(phantom, pose):
    added = acquire(phantom, pose, imaging=NOISY) - acquire(phantom, pose)
    assert np.sqrt(np.mean(np.abs(added) ** 2)) == pytest.approx(
        reference_amplitude(ARRAY) * 10 ** (-50 / 20), rel=0.01
    )


def test_the_ratio_of_signal_to_noise_falls_with_depth_as_attenuation_says():
    """Power of the echoes over that of the noise, which attenuation leaves as it is."""
    frequency = 3.0  # MHz, at which speckle is loudest: elevation weakens higher ones
    ratios = []
    for attenuation in (0.0, 0.5):
        phantom = replace(EMPTY, attenuation_db_per_cm_mhz=attenuation, tissue_density_per_mm3=0.3)
        echoes = np.square(np.abs(acquire(phantom, POSE))).mean(axis=1)
        added = np.square(np.abs(acquire(phantom, POSE, imaging=NOISY) - acquire(phantom, POSE))).mean(axis=1)
        depths = (np.arange(len(echoes)) / ARRAY.iq_sampling_frequency - ARRAY.pulse_delay) * 1540 / 2
        parts = [(depths > z - 5e-3) & (depths < z + 5e-3) for z in (25e-3, 45e-3, 65e-3, 80e-3)]
        ratios.append([10 * np.log10(echoes[part].mean() / added[part].mean()) for part in parts])
    lost = np.subtract(*ratios)
    # 2 a f z, and by it the noise drowns the deep tissue.
    assert lost == pytest.approx(2 * 0.5 * frequency * np.array([2.5, 4.5, 6.5, 8.0]), abs=0.8)
    assert (np.diff(ratios[1]) < 0).all()


def test_what_is_acquired_again_has_the_same_noise_and_anything_else_has_its_own():
    first = noise((400, 64), 50.0, ARRAY, TISSUE, POSE)
    assert np.array_equal(first, noise((400, 64), 50.0, LinearArray(), Phantom(), Pose()))
    for other in (
        noise((400, 64), 50.0, ARRAY, TISSUE, Pose(5, 50, 0)),
        noise((400, 64), 50.0, ARRAY, Phantom(seed=1), POSE),
        noise((400, 64), 50.0, replace(ARRAY, center_frequency=3e6), TISSUE, POSE),
    ):
        assert abs(np.vdot(first, other)) < 0.05 * np.linalg.norm(first) * np.linalg.norm(other)
    louder = noise((400, 64), 30.0, ARRAY, TISSUE, POSE)
    assert louder == pytest.approx(10 * first, rel=1e-5)


def test_settings_of_the_display_do_not_change_it():
    acquired = [
        acquire(TISSUE, Setup(0, 50, 0, frequency_khz=3_500, dynamic_range_db=range_db), imaging=NOISY)
        for range_db in (30, 60)
    ]
    assert np.array_equal(*acquired)
    assert np.array_equal(acquired[0], acquire(TISSUE, POSE, imaging=NOISY))


def test_a_seed_is_the_same_in_every_process_and_version():
    """Frames of a version of a task follow from this number: it may never change."""
    known = seed(Phantom(), Pose(), LinearArray())
    code = (
        "from usbench.envs.receiver.noise import seed\n"
        "from usbench import LinearArray, Phantom, Pose\n"
        "print(seed(Phantom(), Pose(), LinearArray()))\n"
    )
    elsewhere = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert int(elsewhere.stdout) == known == 36820994333008753953844307499495835315


def test_frames_have_the_same_bits_in_a_batch_and_for_any_number_of_threads(monkeypatch):
    scenes = [(Phantom(number), Pose(x, 50, 0)) for number in (0, 1) for x in (0, 5)]
    frames = [scan(*scene, imaging=NOISY) for scene in scenes]
    assert not np.array_equal(frames[0], scan(*scenes[0]))
    for threads in ("1", "2", "3"):
        monkeypatch.setenv("USBENCH_THREADS", threads)
        assert np.array_equal(scan_batch(scenes, imaging=NOISY), frames)
        assert np.array_equal(scan(*scenes[1], imaging=NOISY), frames[1])


def test_noise_that_is_off_changes_no_bit():
    assert np.array_equal(scan(TISSUE, POSE), scan(TISSUE, POSE, imaging=Imaging(noise_db=None)))
    faint = acquire(TISSUE, POSE, imaging=Imaging(noise_db=1e6))
    assert np.array_equal(acquire(TISSUE, POSE), faint)


def test_points_of_ones_own_have_the_same_noise_in_every_process():
    points = PointScatterers([(0, 0, 0.03)], [1.0], label="here")
    assert repr(points) == repr(PointScatterers([(0, 0, 0.03)], [1.0], label="there"))
    assert repr(points) != repr(PointScatterers([(0, 0, 0.031)], [1.0])) and "0x" not in repr(points)
    frame = scan(points, POSE, imaging=NOISY)
    assert np.array_equal(frame, scan(PointScatterers([(0, 0, 0.03)], [1.0]), POSE, imaging=NOISY))


@pytest.mark.parametrize(
    "receive", [{"receive_focus": "dynamic"}, {"receive_focus": 20e-3, "receive_f_number": 4}]
)
def test_the_level_does_not_depend_on_how_the_array_focuses_in_receive(receive):
    # Electronics are as noisy whatever the beamformer does: the reference is that of the shared focus.
    array = LinearArray()
    assert reference_amplitude(replace(array, **receive)) == reference_amplitude(array)
