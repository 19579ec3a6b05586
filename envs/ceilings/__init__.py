"""How well any policy can do that knows no more than an agent is shown: ceilings of scores."""
