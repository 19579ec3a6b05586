"""Many trials: planned, run several at a time, searched, and tested elsewhere."""
