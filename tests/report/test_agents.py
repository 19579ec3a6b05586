"""Which trial stands for an agent, and what a page shows of figures and films."""

import base64
import io

import numpy as np
import pytest
from made_tables import made, seeds, trial
from PIL import Image

from usbench.figures import style
from usbench.report import agents, pictures, tables
from usbench.setting import Setting
from usbench.watch import replay


def test_the_trial_shown_is_the_median_of_those_with_the_least_noise():
    known = made(
        *seeds("vpg", [0.9, 0.1, 0.5], noise=0.25),
        *seeds("vpg", [0.95, 0.96], noise=0.5),
        *seeds("ppo", [0.7, 0.8, 0.6, 0.65], noise=0.25),
        trial("ppo", 0.99, noise=0.0, status="failed"),
        trial("oracle", 1.0, noise=0.25),
        trial("vpg", 0.3, task="pp"),
    )
    chosen = agents.shown(known)
    assert [(one.task, one.agent, one.noise, one.score) for one in chosen] == [
        ("fp", "ppo", 0.25, 0.65),  # the lower of both in the middle
        ("fp", "vpg", 0.25, 0.5),
        ("fp", "oracle", 0.25, 1.0),
        ("pp", "vpg", 0.0, 0.3),
    ]
    assert chosen[1].trials == tuple(f"fp-p0.25-vpg-s{seed}" for seed in range(100, 103))
    assert [one.learns for one in chosen] == [True, True, False, True]


def test_configurations_of_an_agent_are_shown_apart():
    known = made(trial("vpg", 0.5), trial("vpg", 0.6, seed=1, configuration="00000002"))
    assert {one.agent for one in agents.shown(known)} == {"vpg 00000001", "vpg 00000002"}


def test_nothing_finished_shows_nothing():
    assert agents.shown(made(trial("vpg", status="running"))) == []


def content(picture):
    kind, _, data = picture.src.partition(";base64,")
    return kind, base64.b64decode(data)


def test_figures_of_few_lines_are_vectors_and_others_pixels():
    figure, axes = style.panels(1, 1)
    axes[0, 0].plot([0, 1])
    few = pictures.from_figure(figure)
    assert content(few)[0] == "data:image/svg+xml" and b"<svg" in content(few)[1]
    axes[0, 0].plot(np.random.default_rng(0).random((200, 40)))
    many = pictures.from_figure(figure)
    assert content(many)[0] == "data:image/png"
    assert (few.width, few.height) == (many.width, many.height) == (style.SHOWN_PX, round(2.8 * 96))


def test_films_hold_every_page_for_its_time():
    pages = [Image.new("RGB", (60, 40), (level, 0, 0)) for level in (0, 120, 240)]
    for page, duration in zip(pages, (450, 450, 2000), strict=True):
        page.info["duration"] = duration
    film, still = pictures.from_pages(pages)
    with Image.open(io.BytesIO(content(film)[1])) as image:
        assert image.n_frames == 3
        shown = []
        for number in range(3):
            image.seek(number)
            image.load()
            shown.append(image.info["duration"])
    assert shown == [450, 450, 2000]
    with Image.open(io.BytesIO(content(still)[1])) as image:
        assert abs(image.convert("RGB").getpixel((30, 20))[0] - 240) < 10


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        ([0] * 16, "takes the action stay 16 times, and ends at"),
        (
            [2, 2, 3, *[0] * 13],
            "takes the actions right 2 times, rotate counter-clockwise, stay 13 times, and ends at",
        ),
    ],
)
def test_an_episode_is_told_in_words(quick, actions, said):
    setting = Setting(task="pp")
    assert said in agents._words(setting.guidance, list(replay.play(setting, 2, actions)))


def test_every_trial_is_in_its_table_with_its_status():
    rows = tables.trials(made(trial("vpg", 0.5), trial("ppo", status="failed", reason="disk\nfull"))).rows
    assert [row[1] for row in rows] == ["finished", "failed: disk full"]
    assert rows[0][3:] == ["0.500", "2.0"] and rows[1][3] == tables.DASH


def test_settings_are_told_once_for_all_seeds_and_noises():
    known = made(*seeds("vpg", [0.1, 0.2]), *seeds("vpg", [0.1], task="pp", noise=0.5), trial("oracle"))
    assert tables.settings(known).rows == [["vpg", "fp, pp", "16064", "gamma 0.99"]]
