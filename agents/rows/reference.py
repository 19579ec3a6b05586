"""The rows of the reference policies, which learn nothing and look at nothing."""

from usbench.agents.rows.entry import Entry

REFERENCE: dict[str, Entry] = {
    "random": Entry(
        title="reference policy: every action is equally probable",
        cls="usbench.agents.baselines:Random",
        learns=False,
        looks=False,
    ),
    "stay": Entry(
        title="reference policy: never moves", cls="usbench.agents.baselines:Stay", learns=False, looks=False
    ),
    "oracle": Entry(
        title="reference policy: knows the pose and plays the optimum",
        cls="usbench.agents.baselines:Oracle",
        learns=False,
        looks=False,
    ),
}
