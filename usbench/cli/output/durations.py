"""How long something takes, in words."""


def duration(seconds: float) -> str:
    """Return about how long that is: "less than 10 s", "about 40 s", "about 3 min", "about 2.5 h"."""
    if seconds < 10:
        return "less than 10 s"
    if seconds < 95:
        return f"about {10 * round(seconds / 10)} s"
    return f"about {round(seconds / 60)} min" if seconds < 6000 else f"about {seconds / 3600:.1f} h"
