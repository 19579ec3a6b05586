"""Double DQN for unseen phantoms: n-step returns, exact symmetries, a trunk that keeps places."""
