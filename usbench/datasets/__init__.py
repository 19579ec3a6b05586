"""Episodes of agents as data sets from which others learn, written in the format of Minari."""
