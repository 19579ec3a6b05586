"""Freed memory stays with the process, where the C library is glibc."""

import platform
import subprocess
import sys

import pytest

PROGRAM = """
import resource, sys
import numpy as np
from usbench.trials.glibc_memory import keep_freed
if sys.argv[1] == "keep":
    keep_freed()
np.ones(1 << 22)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(1 << 22)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_arrays_of_megabytes_are_not_mapped_anew():
    keep, default = (
        int(subprocess.run([sys.executable, "-c", PROGRAM, word], check=True, capture_output=True).stdout)
        for word in ("keep", "default")
    )
    # 20 arrays of 32 MB; with huge pages by default a mapping has 16 pages, otherwise 8192.
    assert keep < default / 4
