"""The program that sets training beside the measured peak of a core."""

import sys

import peak
import torch


def test_peaks_are_those_of_one_thread(monkeypatch):
    before, threads = torch.get_num_threads(), []
    for name in ("peak", "convolution"):
        monkeypatch.setattr(peak, name, lambda: threads.append(torch.get_num_threads()) or 1.0)
    monkeypatch.setattr(peak, "shares", lambda *_: (1.0, 1.0, [1.0, 1.0]))
    monkeypatch.setattr(sys, "argv", ["peak.py"])
    torch.set_num_threads(2)
    try:
        peak.main()
    finally:
        torch.set_num_threads(before)
    assert threads == [1, 1]
