"""Time gain compensation against theory: of known envelopes, of tissue that attenuates, and of noise."""

import numpy as np
import pytest

from usbench.envs.bmode import Imaging, bmode
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.receiver import gain
from usbench.envs.scanner import acquire, scan

C = 1540.0
ATTENUATION = 0.5
DEPTHS = np.array([-0.01, 0.0, 0.01, 0.02, 0.035, 0.05, 0.09])


def test_a_slope_and_a_curve_give_the_decibels_that_they_say():
    assert gain.gain_db(3.0, DEPTHS) == pytest.approx([0, 0, 3, 6, 10.5, 15, 27])
    curve = ((0.01, -4.0), (0.02, 2.0), (0.05, 20.0))
    assert gain.gain_db(curve, DEPTHS) == pytest.approx([-4, -4, -4, 2, 11, 20, 20])


def test_a_gain_may_be_given_in_any_sequence():
    curve = ((0.0, 0.0), (0.05, 20.0))
    for same in ([[0, 0], [0.05, 20]], np.array(curve), ([0, 0], (0.05, 20.0))):
        assert Imaging(tgc_db_per_cm=same) == Imaging(tgc_db_per_cm=curve)
    assert hash(Imaging(tgc_db_per_cm=np.array(2.0))) == hash(Imaging(tgc_db_per_cm=2))


def image_of_a_loss(imaging, loss_db_per_cm=5.0):
    """The image of an envelope that falls by a slope with depth."""
    rate = 25e6
    depths = np.arange(2922) * C / 2 / rate  # 90 mm
    signals = np.tile(10 ** (-loss_db_per_cm * depths[:, np.newaxis] * 1e2 / 20), 64).astype(complex)
    lines = (np.arange(64) - 31.5) * 0.625e-3
    return bmode(signals, rate, lines, imaging=imaging)


def test_the_gain_that_undoes_a_loss_makes_an_even_image():
    assert (image_of_a_loss(Imaging(tgc_db_per_cm=5.0)) >= 254).all()
    assert (image_of_a_loss(Imaging(tgc_db_per_cm=((0.0, -10.0), (0.1, 40.0)))) >= 254).all()
    too_much = image_of_a_loss(Imaging(tgc_db_per_cm=7.0, median_size=1)).mean(axis=1)
    # 2 dB/cm too much: the deepest pixel is the maximum, and pixel k is 0.2 dB (89 - k) below it.
    expected = 255 * (1 - 0.2 * (89 - np.arange(90)) / 60)
    assert too_much[1:-1] == pytest.approx(expected[1:-1], abs=1.0)


def test_the_largest_gain_neither_overflows_nor_warns():
    # Warnings are errors in these tests.
    image = image_of_a_loss(Imaging(tgc_db_per_cm=100.0), loss_db_per_cm=0.0)
    assert image[-1, 20] >= 225 and not image[:80].any()


# Speckle everywhere.
TISSUE = {"tissue_density_per_mm3": 0.3, "object_of_interest": ObjectOfInterest(contrast=1.0, scale=0.1)}
SLICES = np.arange(20e-3, 85e-3, 5e-3) + 2.5e-3


def spectra(attenuation):
    """Mean power spectra of the I/Q around the depths SLICES, (n_slices, n), over 8 phantoms."""
    array, found = LinearArray(), 0.0
    for seed in range(8):
        iq = acquire(Phantom(seed, attenuation_db_per_cm_mhz=attenuation, **TISSUE), Pose())
        middles = 2 * SLICES / C + array.pulse_delay
        firsts = np.rint(middles * array.iq_sampling_frequency).astype(int) - 16
        parts = np.stack([iq[first : first + 32] for first in firsts]) * np.hanning(32)[:, np.newaxis]
        found = found + np.square(np.abs(np.fft.fft(parts, axis=1))).mean(axis=2)
    return found


@pytest.fixture(scope="module")
def losses():
    """What echoes from SLICES lose by attenuation, dB: as measured, and as theory says of their spectra."""
    array, plain = LinearArray(), spectra(0.0)
    lost = 10 * np.log10(plain.sum(axis=1) / spectra(ATTENUATION).sum(axis=1))
    f = array.iq_center_frequency + np.fft.fftfreq(32, 1 / array.iq_sampling_frequency)
    left = 10 ** (-2 * ATTENUATION * SLICES[:, np.newaxis] * 1e2 * f / 1e6 / 10)
    return lost, 10 * np.log10(plain.sum(axis=1) / (plain * left).sum(axis=1))


def test_tissue_loses_what_theory_says(losses):
    lost, expected = losses
    assert lost == pytest.approx(expected, abs=0.5) and np.ptp(lost) > 15


def test_the_gain_of_theory_flattens_the_image_of_tissue_that_attenuates(losses):
    curve = tuple(zip(SLICES, losses[1], strict=True))
    shown = {"dynamic_range_db": 100.0, "median_size": 1}
    difference = 0.0
    for seed in range(4):
        plain, lossy = (
            Phantom(seed, attenuation_db_per_cm_mhz=loss, **TISSUE) for loss in (0.0, ATTENUATION)
        )
        even = scan(plain, Pose(), imaging=Imaging(**shown)).astype(float)
        for name, gain_of in (("none", 0.0), ("slope", 3.0), ("curve", curve)):
            image = scan(lossy, Pose(), imaging=Imaging(**shown, tgc_db_per_cm=gain_of))
            rows = (image - even)[22:82].mean(axis=1) * 100 / 255
            difference = difference + np.array([rows * (name == one) for one in ("none", "slope", "curve")])
    spread = np.ptp(difference / 4, axis=1)
    # As bright from 22 to 82 mm as without attenuation, by a curve or by 2 a f dB/cm at f = 3 MHz, at which
    # these echoes are loudest; 17 dB darker without.
    assert spread[0] > 15 and spread[1] < 2.0 and spread[2] < 1.5


def test_noise_rises_with_depth_as_the_gain_does():
    empty = Phantom(tissue_density_per_mm3=0.0, object_density_per_mm3=0.0)
    imaging = Imaging(noise_db=60, tgc_db_per_cm=4.0, dynamic_range_db=100.0, median_size=1)
    rows = scan(empty, Pose(), imaging=imaging).mean(axis=1) * 100 / 255
    depths_cm = (np.arange(90) + 0.5) / 10
    slope, _ = np.polyfit(depths_cm, rows, 1)
    assert slope == pytest.approx(4.0, rel=0.03)
    # And is even without a gain.
    even = scan(empty, Pose(), imaging=Imaging(noise_db=60, dynamic_range_db=100.0, median_size=1))
    slope, _ = np.polyfit(depths_cm, even.mean(axis=1) * 100 / 255, 1)
    assert abs(slope) < 0.1
