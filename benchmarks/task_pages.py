"""Write a page for every task and a gallery of them from the code: `make task-pages`, some minutes.

Each page has one episode of the exact optimum, as a moving picture: the evaluation episode with the longest
way. `--text` writes the text again and leaves the pictures as they are.
"""

import argparse
import inspect
import re
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from usbench import suite
from usbench.anchors import Anchors
from usbench.ceilings import bound, ceiling
from usbench.coordinates import BY_NAME
from usbench.setting import Setting
from usbench.watch import panels, replay
from usbench.watch.film import LAST_STEP_MS, STEP_MS

FOLDER = Path(__file__).parents[1] / "docs" / "environments"
QUALITY = 50
WIDTH, STILL_WIDTH = 720, 360
# Of the gallery. The style sheet of the site lays them below each other on telephones.
COLUMNS = 3
CEILING = "[ceiling](../tasks.md#what-can-be-known): largest score of any policy that is told the same"
# Of a task's docstring, what the table does not say.
SECTIONS = ("Action Space", "Observation Space", "Rewards", "Episode End", "Arguments", "Version History")


def text(task: str, anchors: Anchors) -> str:
    """Return the page of a task in Markdown: title, picture, table, and the sections of its docstring."""
    setting = Setting(task=task)
    env, guidance = setting.plain_env(), setting.guidance
    first, sections = described(type(env))
    rows = {
        "Gymnasium id": f"`{setting.row.env_id}`",
        "in usbench": f"`{task}`",
        "actions": "; ".join(f"{number} {action.name}" for number, action in enumerate(guidance.actions)),
        "action space": f"`{env.action_space}`",
        "observation space": f"`{env.observation_space}`",
        "rewards": ", ".join(f"`{kind!r}`" for kind in guidance.rewards),
        "start": starts(setting),
        "end": ("when the agent stops, at the latest" if guidance.stops else "truncated")
        + f" after {guidance.n_steps} steps",
        "arguments": ", ".join(f"`{name}={value!r}`" for name, value in arguments(env).items()),
        "return of the optimum, noise 0": f"{anchors.optimal:.4f} (score 1)",
        "return of the random agent, noise 0": f"{anchors.random:.4f} (score 0)",
        "return of the idle agent, noise 0": f"{anchors.stay:.4f} (score {anchors.score(anchors.stay):.3f})",
        CEILING: largest(task),
        "training budget": f"{setting.row.steps:,} steps".replace(",", " "),
        "evaluation": f"{len(setting.evaluation_episodes())} episodes",
    }
    parts = [
        f"# {guidance.title}: `{task}`",
        first,
        f"![An episode of the exact optimum: scene from above, from the side, and frame]({task}.webp)",
        "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]),
        f'```python\nimport gymnasium as gym, usbench\n\nenv = gym.make("{setting.row.env_id}")\n```',
        sections["Description"],
        *(f"## {name}\n\n{sections[name]}" for name in SECTIONS if name in sections),
    ]
    return "\n\n".join(parts) + "\n"


def largest(task: str) -> str:
    """Return in words which score what an agent is told allows."""
    exact, most = ceiling(task), bound(task)
    if exact is not None:
        return f"score {exact:.3f}"
    if most is not None:
        return f"score at most {most:.3f}, the ceiling of an agent that is told the whole pose"
    return "not computed: the phantom is always the same, so that its frames tell poses apart"


def described(environment: type) -> tuple[str, dict[str, str]]:
    """Return the first sentence of an environment's docstring, and its sections by name."""
    written = linked(inspect.getdoc(environment) or "")
    head, *parts = re.split(r"^## (.+)\n", written, flags=re.MULTILINE)
    return head.strip(), {name: own.strip() for name, own in zip(parts[::2], parts[1::2], strict=True)}


def linked(docstring: str) -> str:
    """Return a docstring with links to the pages of tasks in place of the classes of environments."""
    for task, row in suite.TASKS.items():
        docstring = docstring.replace(f"`{row.entry_point.partition(':')[2]}`", f"[`{task}`]({task}.md)")
    return docstring


def arguments(env: Any) -> dict[str, object]:
    """Return what the class of an environment takes by name, with the defaults of the task.

    `scene` of the class says whether it takes a phantom, or what phantoms are drawn from. None stands for
    what is the task's own, other than senses, which are named.
    """
    found: dict[str, object] = {}
    for base in type(env).__mro__:
        if base.__module__.startswith("usbench") and "__init__" in vars(base):
            own = inspect.signature(base.__init__).parameters.values()  # type: ignore[misc]
            named = {one.name: one.default for one in own if one.kind is one.KEYWORD_ONLY}
            found = named | found
    other = {"phantom", "phantoms"} - set(env.scene)
    return {name: value for name, value in found.items() if name not in other} | {
        "senses": env.default_senses
    }


def starts(setting: Setting) -> str:
    """Return between which values each coordinate starts, in words."""
    poses = setting.guidance.starts
    words = []
    for name in setting.guidance.coordinates:
        values = sorted({getattr(pose, name) for pose in poses})
        label = BY_NAME[name].value
        ends = [label.format(value) for value in (values[0], values[-1])]
        words.append(ends[0] if len(values) == 1 else f"{ends[0]} to {ends[1]}")
    return f"one of {len(poses)} poses: {'; '.join(words)}" if len(poses) > 1 else words[0]


def gallery() -> str:
    """Return the page of thumbnails in Markdown."""
    cells = [thumbnail(task) for task in suite.TASKS]
    cells += [""] * (-len(cells) % COLUMNS)
    rows = [cells[start : start + COLUMNS] for start in range(0, len(cells), COLUMNS)]
    return "\n\n".join(
        [
            "# All tasks",
            "One episode of the exact optimum in each task; a picture leads to the page of its task. "
            "The page [The tasks](../tasks.md) compares them.",
            "\n".join(f"| {' | '.join(row)} |" for row in [[""] * COLUMNS, ["---"] * COLUMNS, *rows]),
            "\n".join(["```{toctree}", ":hidden:", "", *suite.TASKS, "```"]) + "\n",
        ]
    )


def thumbnail(task: str) -> str:
    """Return a task's cell of the gallery: picture, title and first sentence."""
    first, _ = described(type(Setting(task=task).plain_env()))
    still = f"[![A moment of an episode of {task}]({task}.png)]({task}.md)"
    return f"{still}<br>**{suite.TASKS[task].guidance.title}: [`{task}`]({task}.md)**<br>{first}"


def pictures(task: str) -> list[Image.Image]:
    """Return what there is to see in the evaluation episode in which the optimum has the longest way."""
    setting = Setting(task=task)
    phantoms, planner = setting.evaluation_phantoms(), setting.planner()

    def value(episode: suite.EvaluationEpisode) -> float:
        target = astuple(phantoms[episode.phantom_index].target)
        return planner.policy(target).value(0, episode.start)

    # Some of them: every phantom takes a plan of its own.
    longest = min(setting.evaluation_episodes()[:12], key=value)
    policy = planner.policy(astuple(phantoms[longest.phantom_index].target))
    env = setting.plain_env()
    env.is_watched = False
    env.reset(seed=longest.seed, options=longest.options)
    actions: list[int] = []
    while len(actions) < setting.guidance.n_steps:
        actions.append(policy.action(len(actions), env.pose))
        _, _, terminated, truncated, _ = env.step(actions[-1])
        if terminated or truncated:
            break
    moments = replay.play(setting, longest.number, actions)
    return [Image.fromarray(moment.picture) for moment in moments]


def film(pages: list[Image.Image], path: Path) -> None:
    """Write the pages as a moving picture, and one of the first without its words as a still beside it."""
    small = [page.resize((WIDTH, round(page.height * WIDTH / page.width)), Image.LANCZOS) for page in pages]
    durations = [STEP_MS] * (len(small) - 1) + [LAST_STEP_MS]
    small[0].save(path, save_all=True, append_images=small[1:], duration=durations, loop=0, quality=QUALITY)
    # Its words could not be read at that size.
    still, _ = panels.side_by_side(np.asarray(pages[len(pages) // 4]), STILL_WIDTH, STILL_WIDTH)
    Image.fromarray(still).save(path.with_suffix(".png"), optimize=True)


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--text", action="store_true", help="leave the pictures as they are")
    parser.add_argument("--tasks", nargs="+", default=list(suite.TASKS), metavar="TASK")
    args = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "index.md").write_text(gallery())
    for task in args.tasks:
        (FOLDER / f"{task}.md").write_text(text(task, Setting(task=task).anchors()))
        if not args.text:
            film(pictures(task), FOLDER / f"{task}.webp")
        print(FOLDER / f"{task}.md", flush=True)


if __name__ == "__main__":
    main()
