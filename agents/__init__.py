"""The agents: the paper's vanilla policy gradient, the table of algorithms, and the reference policies."""

if __name__ != "usbench.agents":
    raise ImportError(
        f"this folder is the package usbench.agents and cannot be imported as {__name__!r}: "
        "write 'import usbench.agents' instead."
    )
