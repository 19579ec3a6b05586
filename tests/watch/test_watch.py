"""Episodes replayed: the recorded return beside the optimum's, the agent's advice, in files and as text."""

import dataclasses
import io
import re
import weakref
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from PIL import Image, ImageFont
from rich.console import Console

from usbench import cli, records
from usbench.agents import zoo
from usbench.envs import oracle
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.setting import Setting, make_env
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.watch import film, panels, replay, selection, terminal
from usbench.watch.advice import Adviser
from usbench.watch.moment import Advice

LEARNERS = ["vpg", "a2c", "dqn", "qrdqn", "recurrent_ppo", "double_dqn"]


@pytest.fixture
def without_waiting(monkeypatch):
    monkeypatch.setattr(terminal.time, "sleep", lambda _: None)


def moments(folder, number=0):
    chosen = selection.choose(folder, [number])
    return chosen, list(chosen.moments(chosen.episodes[0]))


def agent(algo, task="pp"):
    env = make_env(task)
    plan = {"policy": oracle.policy(task)} if algo == "oracle" else {}
    return zoo.make(algo, env, 0, zoo.hyperparameters(algo, task), **plan)


def test_advice_has_the_memory_of_a_recurrent_agent(quick):
    acting, env = agent("recurrent_ppo"), make_env("pp")
    with torch.no_grad():  # as it begins, its action hardly depends on what it saw or remembers
        for parameter in acting.policy.lstm_actor.parameters():
            parameter.mul_(8)
        acting.policy.action_net.weight.mul_(1000)
    adviser, memory = Adviser(acting), None
    observation, info = env.reset(seed=1)
    remembered = []
    for step in range(6):
        seen = observation[np.newaxis]
        (fresh,), _ = acting.predict(seen, None, np.array([True]), deterministic=True)
        (action,), memory = acting.predict(seen, memory, np.array([step == 0]), deterministic=True)
        assert adviser.advise(observation, info, step).best == action
        remembered.append(action != fresh)
        observation, _, _, _, info = env.step(step % 5)
    assert any(remembered)


@pytest.mark.parametrize("algo", [*LEARNERS, "stay"])
def test_advice_is_what_the_agent_does(quick, algo):
    acting, env = agent(algo), make_env("pp")
    adviser = Adviser(acting)
    for _ in range(2):  # a second episode knows nothing of the first
        observation, info = env.reset(seed=1)
        state = None
        for step in range(6):
            actions, state = acting.predict(
                observation[np.newaxis],
                state=state,
                episode_start=np.array([step == 0]),
                deterministic=True,
            )
            advice = adviser.advise(observation, info, step)
            assert advice.best == int(actions[0])
            if advice.kind == "probability":
                assert sum(advice.weights) == pytest.approx(1.0)
            observation, _, _, _, info = env.step(step % 5)


def test_advice_of_those_that_do_not_learn(quick):
    env = make_env("fp")
    observation, info = env.reset(seed=0, options={"x_mm": -20, "focal_depth_mm": 50})
    assert Adviser(agent("random", "fp")).advise(observation, info, 0).weights == (0.2,) * 5
    # 20 mm to the left of the object, in its depth: only a move to the right gains anything.
    assert Adviser(agent("oracle", "fp")).advise(observation, info, 0).best == 2


def test_advice_of_the_saved_model_is_what_was_recorded(finished):
    chosen, played = moments(finished)
    assert [moment.advice.best for moment in played[:-1]] == chosen.episodes[0]["actions"]
    assert played[-1].advice is None


def test_return_and_final_pose_are_the_records(finished):
    chosen, played = moments(finished, 3)
    record = chosen.episodes[0]
    assert played[-1].return_ == record["return"]
    assert played[-1].pose.x_mm == record["final_x_mm"]
    assert played[-1].distance_mm == record["final_distance_mm"]


def test_optimum_is_the_programmes_value_of_the_start(quick):
    played = list(replay.play(Setting(task="fp", noise=0.0), 1, [0] * 16))
    expected = oracle.policy("fp").value(0, played[0].pose)
    assert played[-1].optimum == pytest.approx(expected)
    assert [played[0].optimum, played[0].return_] == [0.0, 0.0]


def test_who_stops_is_beside_what_the_optimum_has_to_the_end(quick):
    _, last = replay.play(Setting(task="exam-stop"), 1, [7])
    expected = oracle.policy("exam-stop").value(0, last.pose)
    assert last.step == 1 and last.optimum == pytest.approx(expected)


def test_slip_and_goal_leave_room_for_the_advice():
    slipped = {"slip": "15° counter-clockwise", "is_success": True, "reward": -0.86, "distance_mm": 10.0}
    first, second = film.facts(SimpleNamespace(**slipped, return_=-12.34, optimum=-12.34))
    assert second.endswith("at the goal")
    font = ImageFont.load_default(size=film.TEXT_SIZE)
    assert film.LEFT + max(map(font.getlength, (first, second))) < film.ADVICE_LEFT


def test_optimum_meets_the_same_slips(quick):
    plan, pose, actions = oracle.policy("pp", 0.5), None, []
    # Whoever plays as the optimum does has its return, slips and all.
    for _ in range(16):
        *_, last = replay.play(Setting(task="pp", noise=0.5), 2, actions)
        pose = last.pose
        actions.append(plan.action(len(actions), pose))
    played = list(replay.play(Setting(task="pp", noise=0.5), 2, actions))
    assert played[-1].return_ == pytest.approx(played[-1].optimum)
    words = {"5 mm to the left", "5 mm to the right", "15° clockwise", "15° counter-clockwise"}
    assert {moment.slip for moment in played} - {""} <= words and any(moment.slip for moment in played)


def test_episodes_in_pictures_that_move_and_a_video(finished, tmp_path):
    chosen = selection.choose(finished, [0, 3])
    for episode in chosen.episodes:
        del episode["actions"][2:]
    for name in ("a.gif", "a.webp"):
        selection.write(chosen, tmp_path / name)
        with Image.open(tmp_path / name) as animation:
            assert animation.n_frames == 6
            assert animation.format == name[2:].upper()
    selection.write(chosen, tmp_path / "a.mp4")
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    # Two pages of each, and its last one four times as long.
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 12
    assert video.get(cv2.CAP_PROP_FRAME_HEIGHT) % 2 == video.get(cv2.CAP_PROP_FRAME_WIDTH) % 2 == 0
    assert sorted(path.name for path in tmp_path.glob("*a.*")) == ["a.gif", "a.mp4", "a.webp"]


def test_page_marks_the_advised_action(finished):
    _, played = moments(finished)
    names = replay.action_names(Setting(task="pp"))
    page = np.asarray(film.page(played[0], 16, names))
    height = played[0].picture.shape[0]
    rows = page[height + 2 + 22 * played[0].advice.best :][4:16, film.BAR_LEFT :]
    assert (rows == film.BEST).all(axis=2).any()
    np.testing.assert_array_equal(page[:height], played[0].picture)


def test_page_has_room_for_advice_on_every_action_and_tells_the_settings(quick):
    names = replay.action_names(Setting(task="setup"))
    advice = Advice((0.0,) * (len(names) - 1) + (1.0,))
    played = [
        dataclasses.replace(moment, advice=advice)
        for moment in replay.play(Setting(task="setup", noise=0.0), 0, [3, 5])
    ]
    page = np.asarray(film.page(played[0], 2, names))
    top = played[0].picture.shape[0] + 2 + 22 * (len(names) - 1)
    assert (page[top + 4 : top + 16, film.BAR_LEFT : film.BAR_LEFT + film.BAR_WIDTH] == film.BEST).all()
    pose = played[-1].pose
    assert f"{pose.frequency_khz / 1e3:g} MHz, {pose.dynamic_range_db} dB" in terminal.table(played, names)


def test_values_are_shown_as_values():
    advice = Advice((-3.0, -1.25, -0.001), "value")
    assert film.advice_words(advice, ["a", "b", "c"]) == ["a -3.00", "b -1.25", "c 0.00"]
    assert advice.best == 2


def test_an_agent_that_tells_only_its_choice_has_no_numbers(quick):
    env = make_env("pp")
    observation, info = env.reset(seed=0)
    advice = Adviser(agent("stay")).advise(observation, info, 0)
    assert (advice.kind, advice.best, max(advice.bars)) == ("choice", 0, 1)
    names = replay.action_names(Setting(task="pp"))
    assert film.advice_words(advice, names) == names
    played = [
        dataclasses.replace(moment, advice=advice) for moment in replay.play(Setting(task="pp"), 2, [0] * 16)
    ]
    *_, last = terminal.table(played, names).splitlines()
    assert last.split()[0] == "16" and last.endswith("stay")


def test_table_has_a_row_for_every_step(finished, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.main(["watch", str(finished), "--episode", "0"]) == 0
    head, first, second, third, *rows = capsys.readouterr().out.splitlines()
    names = " ".join(f"{first} {second} {third}".split())
    assert head.startswith("vpg on pp, noise 0.5, seed 0: evaluation episode 0 at step 128, greedy")
    for name in ("action", "reward", "optimum", "to", "go", "angle", "advice"):
        assert name in names
    assert names.split().count("mm") == 2 and names.split().count("deg") == 1
    assert len(rows) == 18 and "%" in rows[0] and rows[-1] == "advice for the next: probability of the action"


def test_a_table_goes_where_the_console_writes(finished, capsys):
    file = io.StringIO()
    terminal.show(selection.choose(finished, [0]), Console(file=file))
    assert "advice for the next" in file.getvalue() and capsys.readouterr().out == ""


def test_table_fits_80_columns_with_whole_numbers(quick):
    names = replay.action_names(Setting(task="pp"))
    advice = Advice((0.01,) * (len(names) - 1) + (0.96,))
    played = [
        dataclasses.replace(moment, advice=advice)
        for moment in replay.play(Setting(task="pp", noise=0.5), 2, [4, 3, 1, 2] * 4)
    ]
    shown = terminal.table(played, names)
    assert max(map(len, shown.splitlines())) <= 80 and "…" not in shown
    for moment in played:
        row = rf"^ *{moment.step} .* {film.fixed(moment.return_)} +{film.fixed(moment.optimum)} "
        assert re.search(row, shown, re.MULTILINE)
    assert "focal" not in shown and "slip" in shown
    assert "slip" not in terminal.table(replay.play(Setting(task="pp", noise=0.0), 2, [0] * 16), names)


@pytest.mark.parametrize(("task", "actions"), [("pp", [3] * 16), ("exam", [*[5] * 12, *[3] * 6, *[2] * 6])])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_table_breaks_words_at_hyphens_alone(quick, task, actions, noise):
    setting = Setting(task=task, noise=noise)
    names = replay.action_names(setting)
    turning = [name == "rotate counter-clockwise" for name in names]
    advice = Advice(tuple(-2.07 + turn for turn in turning), "value")
    played = [dataclasses.replace(moment, advice=advice) for moment in replay.play(setting, 2, actions)]
    shown = terminal.table(played, names)
    *rows, meaning = shown.splitlines()
    assert meaning == f"advice for the next: {advice.meaning}"
    parts = set(re.findall("[a-z]+", "\n".join(rows)))
    assert {"rotate", "counter", "clockwise"} <= parts
    headings = (
        "start slip next advice for the to step action reward return optimum x angle focal depth mm deg"
    )
    whole = {*headings.split(), "depth", "go", "left", "right", "deeper", "shallower"}
    whole |= {part for name in names for part in re.findall("[a-z]+", name)}
    whole |= {part for moment in played for part in re.findall("[a-z]+", moment.slip)}
    assert parts <= whole
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("width", [10, 30, 50])
def test_a_table_without_slips_loses_nothing_where_there_is_no_room(quick, width):
    names = replay.action_names(Setting(task="pp"))
    played = [
        dataclasses.replace(moment, advice=Advice((0.01,) * (len(names) - 1) + (0.96,)))
        for moment in replay.play(Setting(task="pp", noise=0.0), 2, [4, 3, 1, 2] * 4)
    ]
    shown, *_ = terminal.table(played, names, width).split("advice for the next:")
    assert "…" not in shown and shown.count("96") == len(played)
    assert all(len(re.findall(rf"^ *{moment.step} ", shown, re.MULTILINE)) == 1 for moment in played)


def test_a_title_fits_the_console(finished, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    assert cli.main(["watch", str(finished)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("vpg on pp") and max(map(len, lines)) <= 60


def test_terminal_shows_colour_blocks_and_words(finished, without_waiting):
    console = Console(file=io.StringIO(), force_terminal=True, width=100, height=30, color_system="truecolor")
    terminal.show(selection.choose(finished, [0]), console)
    shown = console.file.getvalue()
    for words in (
        "step 16/16",
        "optimum in this episode",
        "advice (probability of the action): ",
        "▀",
        "38;2;",
    ):
        assert words in shown


@pytest.mark.parametrize(("width", "height"), [(80, 24), (40, 15), (200, 60)])
def test_scene_fits_the_terminal(finished, width, height):
    _, played = moments(finished)
    image, starts = panels.side_by_side(played[0].picture, width, 2 * height)
    _, side, frame = starts.values()
    assert image.shape[0] <= 2 * height and image.shape[0] % 2 == 0 and image.shape[1] <= width
    # Two pixels make a character twice as high as wide: 80 mm across is as long as 80 mm of depth.
    assert (frame - side - panels.GAP) / image.shape[0] == pytest.approx(400 / 490, rel=0.15)


@pytest.mark.parametrize(("height_px", "width_px"), [(128, 128), (64, 20)])
def test_watching_follows_the_trials_probe_and_imaging(quick, tmp_path, height_px, width_px):
    imaging = Imaging(height_px=height_px, width_px=width_px)
    config = resolve("vpg", "pp", steps=64, probe=LinearArray(n_lines=96), imaging=imaging)
    folder = runner.run_trial(config, tmp_path).folder
    chosen, played = moments(folder)
    assert chosen.setting.probe.width == pytest.approx(60e-3) and chosen.setting.imaging == imaging
    assert [moment.advice.best for moment in played[:-1]] == chosen.episodes[0]["actions"]
    selection.write(chosen, tmp_path / "a.webp")
    with Image.open(tmp_path / "a.webp") as animation:
        assert animation.n_frames == 17 and animation.width >= film.WIDTH
    image, starts = panels.side_by_side(played[0].picture, 100, 60)
    assert image.shape[1] <= 100 and image.shape[0] <= 60 and len(starts) == 3
    assert "advice for" in terminal.table(iter(played), chosen.names)


def test_blocks_in_colour_and_in_grey():
    image = np.array([[[255, 0, 0], [0, 0, 0]], [[0, 0, 255], [0, 0, 0]]], np.uint8)
    colored = terminal.blocks(image, "truecolor")
    assert colored.plain == "▀▀\n"
    style = colored.spans[0].style
    assert (style.color.triplet, style.bgcolor.triplet) == ((255, 0, 0), (0, 0, 255))
    white = np.full((2, 1, 3), 255, np.uint8)
    for few in (None, "standard"):
        assert terminal.blocks(np.concatenate([white, 0 * white], axis=1), few).plain == "█ \n"


def test_256_colours_are_the_nearest_there_are():
    # Dark and hardly coloured, as the scene's background: no loud blue of the cube.
    for color, number in (((20, 24, 32), 234), ((255, 0, 0), 196), ((128, 128, 128), 244)):
        pixels = np.full((2, 1, 3), color, np.uint8)
        assert terminal.blocks(pixels, "256").spans[0].style.color.number == number


def test_interruption_gives_the_cursor_back(finished, monkeypatch):
    console = Console(file=io.StringIO(), force_terminal=True, width=80, height=24)

    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(terminal.time, "sleep", interrupt)
    with pytest.raises(KeyboardInterrupt):
        terminal.show(selection.choose(finished), console)
    hidden, shown = "\x1b[?25l", "\x1b[?25h"
    assert console.file.getvalue().rfind(shown) > console.file.getvalue().rfind(hidden) >= 0


def test_without_a_model_it_plays_without_advice_and_says_so(finished, capsys):
    (finished / records.MODEL).unlink()
    assert cli.main(["watch", str(finished), "--sampled"]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith("without advice: there is no model") and "sampled actions" in captured.out


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--episode", "99"], "from 0 to 3, not 99"),
        (["--episode", "first"], "'first'"),
        (["--out", "a.avi"], ".gif, .webp, .mp4, not 'a.avi'"),
        (["--out", "no/where.gif"], "a folder that exists"),
    ],
)
def test_what_cannot_be_watched_is_refused(finished, capsys, argv, said):
    assert cli.main(["watch", str(finished), *argv]) == 2
    captured = capsys.readouterr()
    assert said in captured.err and captured.err.count("\n") == 1 and captured.out == ""


def test_folder_that_is_no_trial_is_refused(tmp_path, capsys):
    assert cli.main(["watch", str(tmp_path)]) == 2
    assert "is not the folder of a trial" in capsys.readouterr().err
    (tmp_path / records.TRIAL).write_text("[]")
    assert cli.main(["watch", str(tmp_path)]) == 2


def one_page():
    image = Image.new("RGB", (8, 8))
    image.info["duration"] = 100
    return image


def test_a_replay_of_another_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"a replay must end with one of .*\.gif.*, not 'a\.avi'"):
        film.write(tmp_path / "a.avi", [one_page()])


def test_a_video_holds_no_more_than_two_pages_at_once(tmp_path):
    alive = []

    def pages():
        for _ in range(10):
            page = one_page()
            alive.append(weakref.ref(page))
            yield page
            del page
            assert sum(one() is not None for one in alive) <= 2

    film.write(tmp_path / "a.mp4", pages())
    assert len(alive) == 10 and (tmp_path / "a.mp4").stat().st_size


def test_where_opencv_writes_no_video_the_other_formats_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(film, "CODECS", ())
    with pytest.raises(OSError, match=r"cannot write \.mp4: choose \.gif or \.webp"):
        film.write(tmp_path / "a.mp4", [one_page()])
    assert not list(tmp_path.iterdir())
