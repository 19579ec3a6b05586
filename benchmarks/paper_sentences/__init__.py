"""The sentences of the paper's results, each with the rule that decides whether it holds here."""
