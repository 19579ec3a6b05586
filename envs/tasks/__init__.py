"""The tasks: one file for each task or family of tasks, with what is particular to it."""
