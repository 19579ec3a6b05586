"""Double DQN for phantoms never seen: n-step returns, exact symmetries, a trunk that keeps places."""
