"""Layers of the paper's trunk that take fewer passes over memory than PyTorch's."""
