"""How the RF of `usbench.envs.rf` is computed fast: responses, their tables, compiled sums."""
