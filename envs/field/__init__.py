"""How the RF of `usbench.envs.rf` is computed: fast, and, to be read, by `slow_sum.py`."""
