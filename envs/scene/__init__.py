"""The picture of an examination, which `render` returns."""
