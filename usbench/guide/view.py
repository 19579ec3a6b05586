"""An examination as plain data and sentences, as the page shows it."""

import base64
from dataclasses import asdict
from typing import Any

from usbench.envs.scene.picture import Probe
from usbench.guide.controls import controls, name
from usbench.guide.examination import Examination
from usbench.results.text import number
from usbench.watch.film import advice_numbers, fixed


def seen(examination: Examination, *, hidden: bool, for_good: bool = False) -> dict[str, Any]:
    """Return the episode; while the object is hidden, without anything that tells where it is before the end.

    With `for_good`, the object itself is not shown at the end either: the same phantom may come again.

    Among it, of the picture: `frame_mm` is depth and width of the frame, `reach_mm` how far the probe's
    centre can be from x = 0.
    """
    tells = examination.over or not hidden
    phantom, frame, imaging = examination.phantom, examination.frame, examination.setting.imaging
    known = phantom.object_of_interest
    shows = not hidden or (examination.over and not for_good)
    balls: Any = known.balls if shows and known is not None else ()
    return {
        "controls": [asdict(control) for control in controls(examination.guidance)],
        "step": len(examination.actions),
        "n_steps": examination.n_steps,
        "over": examination.over,
        "pose": asdict(examination.pose),
        "frame": base64.b64encode(frame.tobytes()).decode(),
        "shape": frame.shape,
        "frame_mm": [round(1e3 * size, 3) for size in (imaging.depth, imaging.width)],
        "phantom": {size: getattr(phantom, size) for size in ("width_mm", "height_mm", "depth_mm")},
        "balls": [[*ball.center_mm, ball.radius_mm] for ball in balls],
        "target": asdict(phantom.target) if known is None and shows else None,
        "probe": asdict(Probe.of(examination.setting.probe)),
        "reach_mm": max(map(abs, examination.guidance.limits.x_mm)),
        "happened": happened(examination),
        "at_goal": examination.at_goal if tells else None,
        "return": fixed(examination.return_) if tells else None,
        "optimum": fixed(examination.optimum[_steps(examination)]) if tells else None,
        "verdict": verdict(examination),
        "percent": _percent(examination, examination.return_) if examination.over else "",
    }


def _steps(examination: Examination) -> int:
    """Return how many steps the return counts: of an episode that was stopped, those that were left too."""
    return examination.n_steps if examination.over else len(examination.actions)


def happened(examination: Examination) -> str:
    """Return the last action and its slip in words."""
    if not examination.actions:
        return "The probe is at its start."
    done = name(examination.guidance.actions[examination.actions[-1]])
    blocked = ": not possible, the probe is at its limit" if examination.blocked else ""
    slip = f"; then the probe slipped, {examination.slip}" if examination.slip else ""
    return f"{done.capitalize()}{blocked}{slip}."


def verdict(examination: Examination) -> str:
    """Return in words how the episode ended, what follows on `percent`; empty before its end."""
    if not examination.over:
        return ""
    ended = "Success: the probe is" if examination.at_goal else "No success: the probe is not"
    slips = f" With the same slips, the optimum has {_percent(examination, examination.optimum[-1])}."
    return f"of the best from this start. {ended} at the goal.{slips if examination.setting.noise else ''}"


def _percent(examination: Examination, return_: float) -> str:
    """Return a score from this start in per cent: 0 % is a random agent, 100 % the mean optimum."""
    return f"{number(100 * examination.score(return_), 0)} %"


def advice(examination: Examination) -> dict[str, Any] | None:
    """Return the advice in words, with the weight of every action as text and as the length of a bar."""
    asked = examination.advice
    if asked is None:
        return None
    advised = controls(examination.guidance)[asked.best]
    return {
        "action": asked.best,
        "words": advised.advice,
        "icon": advised.icon,
        "kind": asked.kind,
        "texts": advice_numbers(asked),
        "bars": asked.bars,
    }
