"""The simulated examination: probe poses, phantom, RF, B-mode frames and the Gymnasium environments."""

if __name__ != "usbench.envs":
    raise ImportError(
        f"this folder is the package usbench.envs and cannot be imported as {__name__!r}: "
        "write 'import usbench.envs' instead."
    )
