"""Records in, tables out: fast, pure and reproducible; nothing here imports torch."""
