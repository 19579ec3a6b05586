"""Commands for what is given to others: data sets of episodes, and trials for the leaderboard."""
