"""The rows of the table of algorithms, as literal values: importing them imports no algorithm."""
