"""A protocol of seconds, as a file to change."""

QUICK = """
[pools]
development = { first = 0, last = 9 }
comparison = { first = 100, last = 999 }
search = { first = 1000, last = 1999 }

[search]
rows = ["a2c", "vpg"]
candidates = 3
tasks = ["pp"]
noises = [0.0, 0.5]

[[search.rungs]]
steps = 32
seeds = [1000]
keep = 2

[[search.rungs]]
steps = 64
seeds = [1001]
keep = 1

[comparison]
rows = ["a2c"]
tasks = ["pp"]
noises = [0.0]
seeds = 2
"""


def write(folder, *changes, text=QUICK):
    """The path of a protocol with `changes`, pairs of texts; each must be in it."""
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = folder / "protocol.toml"
    path.write_text(text)
    return path
