"""RF, single points and images beside those of an independent code."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from unittest import mock

import numpy as np

from simulation.measuring import REFERENCE, Floats, Row, correlation
from usbench.envs import rf as module
from usbench.envs.bmode import bmode, envelope, log_compress
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_rf
from usbench.setting_parts.toml_files import presets, read_probe

N_POINTS = 500  # for one line so few are summed directly


def accuracy() -> Iterator[Row]:
    """Compare RF, single points and images with the reference."""
    data = dict(np.load(REFERENCE))
    for i, (focus, asked, asked_line) in enumerate(((50, 0.998, 0.98), (20, 0.996, 0.97))):
        rf, time_s = simulate_rf(
            data["points"], data["amplitudes"], DEFAULT_ARRAY, focus * 1e-3, data["x_lines"]
        )
        ours = rf[:3200].astype(np.float64)
        theirs = data["rf_fst"][i, :, : len(ours)].T.astype(np.float64)
        lines = [correlation(a, b) for a, b in zip(ours.T, theirs.T, strict=True)]
        energy = np.square(theirs).sum(axis=0)
        loud = energy >= 0.01 * energy.mean()
        yield (
            f"RF correlation, focus {focus} mm, {len(lines)} lines",
            f"{correlation(ours, theirs):.5f}",
            f"at least {asked}",
        )
        worst = min(np.array(lines)[loud])
        yield (
            f"RF correlation, focus {focus} mm, worst of {loud.sum()} lines",
            f"{worst:.4f}",
            f"at least {asked_line}",
        )

        envelopes = [log_compress(envelope(signals), 60.0) for signals in (ours, theirs)]
        yield image_row(f"60 dB image, focus {focus} mm: rms above -40 dB", *frames(data, ours, theirs))
        yield image_row(f"the same, envelope at the RF's samples, focus {focus} mm", *envelopes)
        yield from points(data, i, focus, float(np.sqrt(np.square(theirs).sum() / np.square(ours).sum())))


def probes() -> Iterator[Row]:
    """Compare the table of each probe with the direct sum: points in its slice, 10 to 45 mm deep.

    The direct sum, which `simulate_rf` takes for single lines of so few points, has the elements' height as
    the slow sum has it.
    """
    few = replace(DEFAULT_ARRAY, n_active=8)
    named = {name: read_probe(name) for name in presets()}
    for name, probe in {"default": DEFAULT_ARRAY, "default, 8 active elements": few, **named}.items():
        rng, beside = np.random.default_rng(0), probe.slice_thickness / 2
        points = rng.uniform((-0.012, -beside, 0.010), (0.012, beside, 0.045), (N_POINTS, 3))
        scene = points, rng.normal(size=N_POINTS), probe, 30e-3
        lines = probe.line_positions[np.abs(probe.line_positions) <= 0.012]
        rf, _ = simulate_rf(*scene, lines)
        ours, direct = [], []
        for k in np.linspace(0, len(lines) - 1, 5).astype(int)[1:-1]:
            one, _ = simulate_rf(*scene, lines[k : k + 1])
            n = min(len(rf), len(one))
            ours.append(rf[:n, k].astype(np.float64))
            direct.append(one[:n, 0].astype(np.float64))
        likeness = correlation(np.concatenate(ours), np.concatenate(direct))
        yield f"{name}: RF correlation of table and direct sum", f"{likeness:.4f}", "at least 0.99"


def frames(data: dict[str, Floats], *signals: Floats) -> list[Floats]:
    """Return the frames in dB above black that the product's chain makes of RF at the reference's lines."""
    return [
        bmode(rf, DEFAULT_ARRAY.rf_sampling_frequency, data["x_lines"], -DEFAULT_ARRAY.pulse_delay)
        * (60 / 255)
        for rf in signals
    ]


def image_row(what: str, ours: Floats, theirs: Floats) -> Row:
    """Compare images in dB above black where the reference is above -40 dB of 60."""
    rms = float(np.sqrt(np.square(ours - theirs)[theirs > 20.0].mean()))
    return what, f"{rms:.2f} dB", "at most 1 dB"


def points(data: dict[str, Floats], i: int, focus: int, gain: float) -> Iterator[Row]:
    """Compare single points within 30 dB of the strongest at their depth; all others are only counted.

    They are computed as frames are, from tables of responses: so few pairs are summed directly else.
    """
    correlations, errors_db, n = [], [], 0
    peaks = np.abs(data["pt_rf"][i]).max(axis=-1)
    for iz, ix, iy in np.ndindex(*peaks.shape):
        n += 1
        if peaks[iz, ix, iy] < peaks[iz].max() * 10 ** (-30 / 20):
            continue
        position = [[data["pt_x"][ix], data["pt_y"][iy], data["pt_z"][iz]]]
        with mock.patch.object(module, "FEW_PAIRS", 0):
            rf, time_s = simulate_rf(position, [gain], DEFAULT_ARRAY, focus * 1e-3, [0.0])
        first = round(float(data["pt_t0"][i, iz, ix, iy]) * DEFAULT_ARRAY.rf_sampling_frequency)
        ours = np.zeros(1600)
        part = rf[first : first + 1600, 0]
        ours[: len(part)] = part
        theirs = data["pt_rf"][i, iz, ix, iy].astype(np.float64)
        correlations.append(correlation(ours, theirs))
        errors_db.append(abs(20 * np.log10(np.abs(ours).max() / np.abs(theirs).max())))
    what = f"{len(correlations)} of {n} points within 30 dB, focus {focus} mm"
    yield f"{what}: least correlation", f"{min(correlations):.4f}", "at least 0.97"
    yield f"{what}: largest gain error", f"{max(errors_db):.2f} dB", "at most 1 dB"
