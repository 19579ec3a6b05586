"""Episodes and frames to look at: as files, in the terminal, step by step."""
