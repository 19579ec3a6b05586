"""One trial: its configuration, its training, its evaluation, and how it goes on after a kill."""
