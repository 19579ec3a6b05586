"""One page about a set of trials, which works offline."""
