"""Figures, drawn from records and tables alone."""
