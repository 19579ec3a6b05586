"""Tables and figures of the committed leaderboard, imported as `usbench.published`."""
