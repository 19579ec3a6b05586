"""Custom anatomy: a 3-D image as tissue, simulated or sliced."""
