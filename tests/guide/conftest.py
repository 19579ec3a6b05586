"""Guides of these tests know the trials that a test makes, and no agent that comes with the package."""

import pytest

from usbench import released


@pytest.fixture(autouse=True)
def _none_released(monkeypatch, tmp_path):
    monkeypatch.setattr(released, "FOLDER", tmp_path / "no agents")
