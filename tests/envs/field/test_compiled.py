"""Compiled code is not used once what it was made of has changed."""

import os

from usbench.envs.field.compiled import forget_older


def _file(path, time):
    path.parent.mkdir(exist_ok=True)
    path.touch()
    os.utime(path, (time, time))
    return path


def test_forgets_code_that_is_older_than_what_it_is_made_of(tmp_path):
    module, part = _file(tmp_path / "sums.py", 10), _file(tmp_path / "part.py", 30)
    old = _file(tmp_path / "__pycache__" / "sums.f-1.py311.nbi", 20)
    new = _file(tmp_path / "__pycache__" / "sums.g-9.py311.nbi", 40)
    other = _file(tmp_path / "__pycache__" / "sums_of_others.f-1.py311.nbi", 20)
    forget_older(str(module), str(part))
    assert not old.exists() and new.exists() and other.exists()


def test_needs_no_files(tmp_path):
    forget_older(str(tmp_path / "sums.py"), str(tmp_path / "gone.py"))
