"""A study: what is played, what is recorded, and how report and leaderboard show it."""

import json
import shutil
import threading

import pytest

from usbench import cli, records
from usbench.envs import guidance
from usbench.guide import agents, examination, study, study_record
from usbench.guide.session import Session
from usbench.records import ConfigurationError
from usbench.records.journal import read_rows
from usbench.records.lock import locked
from usbench.results import studies
from usbench.setting import Setting
from usbench.trials.evaluation import Evaluator


@pytest.fixture(autouse=True)
def _drawn_frames(quick, monkeypatch):
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    monkeypatch.setattr(study, "EPISODES", 2)


def raise_(error):
    raise error


def play(session, *, obedient=True):
    """Play the rest of a study: with advice as advised, otherwise without a move."""
    while session.study.now is not None:
        if session.examination.over:
            session.begin()
        while not session.examination.over:
            advice = session.state()["advice"]
            session.act(advice["action"] if advice and obedient else 0)
    return read_rows(session.study.folder / records.EVALUATIONS)


@pytest.mark.parametrize("name", ["anna", "ben", "3"])
def test_every_episode_is_played_in_both_ways_and_each_way_comes_first_as_often(name, monkeypatch):
    monkeypatch.setattr(study, "EPISODES", 8)
    setting = Setting(task="fp-random")
    plays = study.plan(name, setting)
    n = len(plays) // 2
    assert plays == study.plan(name, setting) and n == min(8, len(setting.evaluation_episodes()))
    assert {one.episode for one in plays[:n]} <= set(setting.evaluation_episodes())
    for first, second in zip(plays[:n], plays[n:], strict=True):
        assert first.episode == second.episode and first.advised != second.advised
    assert sum(one.advised for one in plays[:n]) in (n // 2, n - n // 2)
    assert len({study.plan(other, setting)[0].advised for other in "abcdefgh"}) == 2


def test_the_object_of_a_study_is_not_shown_at_the_end_of_an_episode(tmp_path):
    """The same phantom comes a second time."""
    session = Session(tmp_path, study="anna")
    while not session.examination.over:
        session.act(0)
    state = session.state()
    assert state["over"] and state["balls"] == [] and state["target"] is None


def test_rows_are_those_of_evaluations_and_tell_advice_obedience_and_seconds(finished):
    session = Session(finished.parent, finished, study="anna")
    rows = play(session)
    assert [row["player"] for row in rows].count("human + advice") == 2
    assert (
        [row["player"] for row in rows].count("agent")
        == [row["player"] for row in rows].count("optimum")
        == 2
    )
    setting = session.setting
    evaluator = Evaluator(setting, setting.evaluation_episodes())
    loaded = evaluator.play(session.advisers.opened.adviser._agent, checkpoint=0, step=0, deterministic=True)
    for row in rows:
        n = len(row["actions"])
        if row["player"] in ("human", "human + advice"):
            assert len(row["advice"]) == len(row["obeyed"]) == len(row["seconds"]) == n
            assert row["obeyed"] == [a == b for a, b in zip(row["advice"], row["actions"], strict=True)]
            # Nobody knows when the page was opened: the first step of all has no time.
            first = row["episode"] == 0
            assert (row["seconds"][0] is None) == first and min(row["seconds"][first:]) >= 0
        if row["player"] == "human + advice":
            assert all(row["obeyed"])
        if row["player"] == "agent":  # as every trial records it
            own = loaded[row["eval_episode"]].as_row() | {"episode": row["episode"]}
            assert {key: row[key] for key in own} == json.loads(json.dumps(own))
    evaluator.close()


def test_a_persons_episode_is_kept_though_the_guide_ends_while_the_agent_plays(tmp_path, monkeypatch):
    session = Session(tmp_path, study="anna")
    with monkeypatch.context() as patch:
        patch.setattr(study.Study, "_played", lambda *_: raise_(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            play(session)
    session.close()
    (row,) = read_rows(session.study.folder / records.EVALUATIONS)
    assert row["player"] in ("human", "human + advice")
    session = Session(tmp_path, study="anna")
    rows = read_rows(session.study.folder / records.EVALUATIONS)
    assert [(one["episode"], one["player"]) for one in rows[1:]] == [(0, "agent"), (0, "optimum")]
    assert session.study.n_done == 1


@pytest.mark.parametrize("line", ['{"episode": 0}\n', "{\n", "[]\n"])
def test_a_damaged_record_of_a_study_is_refused_by_its_name(tmp_path, line):
    session = Session(tmp_path, study="anna")
    session.close()
    (session.study.folder / records.EVALUATIONS).write_text(line)
    with pytest.raises(ConfigurationError, match="anna.* is not the record of a study"):
        Session(tmp_path, study="anna")


def test_study_goes_on_where_it_ended_and_torn_lines_do_no_harm(tmp_path):
    session = Session(tmp_path, study="anna")
    while not session.examination.over:
        session.act(0)
    path = session.study.folder / records.EVALUATIONS
    with path.open("a") as file:
        file.write('{"episode"')
    session.close()
    session = Session(tmp_path, study="anna")
    assert session.study.n_done == 1
    rows = play(session)
    assert len(rows) == 8 and session.state()["ended"]
    with pytest.raises(ConfigurationError, match="The study anna is finished"):
        session.begin()


def test_a_study_keeps_its_agent_where_a_better_one_has_appeared(finished, tmp_path):
    session = Session(tmp_path, study="anna")
    play_once(session)
    session.close()
    shutil.copytree(finished, tmp_path / finished.name)
    assert Session(tmp_path).advisers.name == finished.name
    again = Session(tmp_path, study="anna")
    assert again.advisers.name == session.advisers.name == agents.ORACLE and again.study.n_done == 1


def test_a_study_is_played_in_one_guide_at_a_time(tmp_path):
    first = Session(tmp_path, study="anna")
    with pytest.raises(ConfigurationError, match="the study 'anna' is played in another guide"):
        Session(tmp_path, study="anna")
    thread = threading.Thread(target=first.close)  # as in a server, whose work may be done in another thread
    thread.start()
    thread.join()
    assert Session(tmp_path, study="anna").study.n_done == 0


def test_a_guide_that_is_refused_records_nothing_of_a_study(tmp_path):
    """The one that plays it may not have begun its record yet: it would go on with another's."""
    with locked(study.folder_of(tmp_path, "anna")):
        with pytest.raises(ConfigurationError, match="the study 'anna' is played in another guide"):
            Session(tmp_path, study="anna")
        assert not (study.folder_of(tmp_path, "anna") / study.STUDY).exists()


def unopened(setting):
    raise ConfigurationError("there is no such optimum.")


def test_what_would_spoil_a_study_is_refused(tmp_path, monkeypatch):
    session = Session(tmp_path, study="anna")
    session.act(0)
    for spoil in (session.begin, session.follow, session.train, lambda: session.choose(hidden=False)):
        with pytest.raises(ConfigurationError, match="a study"):
            spoil()
    state = session.state()
    assert state["hidden"] and state["balls"] == [] and state["step"] == 1
    with pytest.raises(
        ConfigurationError, match=r"has begun with another task \(pp, not fp\): give the same options"
    ):
        Session(tmp_path, study="anna", task="fp")
    with monkeypatch.context() as patch, pytest.raises(ConfigurationError, match="no such optimum"):
        patch.setattr(agents, "open_oracle", unopened)
        Session(tmp_path, study="berta")
    for name in ("", "../anna", "a b", "x" * 65, "-a"):
        with pytest.raises(ConfigurationError, match="the name of a study must be"):
            Session(tmp_path, study=name)


def test_report_and_leaderboard_show_the_rows(finished, tmp_path, capsys, monkeypatch):
    # Figures take most of the time, and tables are what is looked at.
    monkeypatch.setattr("usbench.figures.comparison.draw", lambda known: {})
    monkeypatch.setattr("usbench.report.poses.overview", lambda known: None)
    play(Session(finished.parent, finished, study="anna"))
    table = studies.gather(finished.parent)
    assert list(table["player"]) == list(studies.PLAYERS) and set(table["episodes"]) == {2}
    advised, agent = (table[table["player"] == who].iloc[0] for who in (studies.ADVISED, studies.AGENT))
    assert advised["return"] == pytest.approx(agent["return"]) and advised["obeyed"] == 1
    assert (
        cli.main(["leaderboard", "--runs", str(finished.parent), "--leaderboard", str(tmp_path / "board.md")])
        == 0
    )
    board = (tmp_path / "board.md").read_text()
    assert "## People" in board
    for who in studies.PLAYERS:
        assert f"| anna | pp | 0.5 | {who} | 2 |" in board
    assert (
        cli.main(["leaderboard", "--leaderboard", str(tmp_path / "board.md")]) == 0
    )  # from the tables alone
    assert (tmp_path / "board.md").read_text() == board
    assert cli.main(["report", str(finished.parent), "--out", str(tmp_path / "r.html"), "--quiet"]) == 0
    page = (tmp_path / "r.html").read_text()
    assert "<span>Studies of <code>usbench guide --study</code>, a row" in page
    assert 'aria-label="Studies of usbench guide --study, a row' in page and "(in <code>setup</code>," in page
    assert '<h3 id="people">People</h3>' in page and all(f"<td>{who}</td>" in page for who in studies.PLAYERS)


def play_once(session):
    """Play one episode of a study without a move."""
    if session.examination.over:
        session.begin()
    while not session.examination.over:
        session.act(0)


def test_players_are_compared_over_the_episodes_that_were_played_in_both_ways(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "EPISODES", 4)
    session = Session(tmp_path, study="anna")
    shown = []
    for _ in range(8):
        play_once(session)
        table = studies.gather(tmp_path)
        assert list(table["player"]) == list(studies.PLAYERS) and table["episodes"].nunique() == 1
        shown.append((studies.texts(table)[0][0], int(table["episodes"][0])))
    assert shown == [
        *((f"anna ({n} of 8 played)", max(n - 4, 0)) for n in range(1, 8)),
        ("anna", 4),
    ]
    rows = read_rows(session.study.folder / records.EVALUATIONS)
    records_of = session.study.folder / records.EVALUATIONS
    records_of.write_text("".join(f"{json.dumps(row)}\n" for row in rows if row["episode"] < 5))
    table = studies.gather(tmp_path).set_index("player")
    both = next(row["eval_episode"] for row in rows if row["episode"] == 4)
    for player in studies.PLAYERS:
        (own,) = [row for row in rows if row["player"] == player and row["eval_episode"] == both]
        assert table.loc[player, "return"] == pytest.approx(own["return"])


def test_another_study_of_one_name_is_added_only_if_asked_for(finished, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("usbench.figures.comparison.draw", lambda known: {})
    play_once(Session(finished.parent, finished, study="anna"))
    board = tmp_path / "board.md"
    assert cli.main(["leaderboard", "--runs", str(finished.parent), "--leaderboard", str(board)]) == 0
    theirs = studies.read(tmp_path / "board_files")
    studies.write(theirs.assign(agent="another"), tmp_path / "board_files")
    add = ["leaderboard", "--add", str(finished.parent), "--leaderboard", str(board)]
    assert cli.main(add) == 2
    told = capsys.readouterr().err
    assert "another study 'anna' (pp, noise 0.5, advice by another, 1 of 4 played). --replace puts" in told
    assert cli.main([*add, "--replace"]) == 0
    assert studies.read(tmp_path / "board_files").equals(theirs)


def test_a_study_without_an_episode_in_both_ways_has_no_score(tmp_path):
    play_once(Session(tmp_path, study="anna"))
    for row in studies.texts(studies.gather(tmp_path)):
        assert row[0] == "anna (1 of 4 played)" and row[4:] == ["0", "–", "–", "–", "–", "–"]


def test_a_study_of_an_earlier_version_goes_on(tmp_path):
    session = Session(tmp_path, study="anna")
    session.close()
    path = session.study.folder / studies.STUDY
    before = json.loads(path.read_text())
    assert before.pop("plays") == 4
    path.write_text(json.dumps(before))
    assert len(play(Session(tmp_path, study="anna"))) == 8
    assert [row[0] for row in studies.texts(studies.gather(tmp_path))] == ["anna"] * 4


def test_studies_alone_are_a_report_and_no_leaderboard(tmp_path, capsys):
    runs, out = tmp_path / "runs", tmp_path / "r.html"
    play(Session(runs, study="anna"))
    assert cli.main(["report", str(runs), "--out", str(out), "--quiet"]) == 0
    page = out.read_text()
    assert "There is no trial beside the studies" in page and "<td>human + advice</td>" in page
    assert "0 trials" not in page and "learning algorithm" not in page and "eaderboard" not in page
    assert cli.main(["report", str(runs / "study-anna"), "--out", str(out), "--quiet"]) == 0
    assert out.read_text() == page
    for option in ("--runs", "--add"):
        assert cli.main(["leaderboard", option, str(runs), "--leaderboard", str(tmp_path / "b.md")]) == 2
        assert "only what usbench report shows, studies (study-anna)" in capsys.readouterr().err


def test_damaged_study_is_named(tmp_path):
    play(Session(tmp_path, study="anna"))
    (tmp_path / "study-anna" / "study.json").write_text("[]")
    with pytest.raises(ConfigurationError, match="study.json' is not the record of a study"):
        Session(tmp_path, study="anna")
    (tmp_path / "study-anna" / "study.json").write_text("{}")
    with pytest.raises(ConfigurationError, match="study-anna' is not the record of a study"):
        studies.gather(tmp_path)
    (tmp_path / "study-anna" / "study.json").write_text("[" * 100_000)
    assert study_record.agent_of(tmp_path, "anna") is None
    with pytest.raises(ConfigurationError, match="study-anna' is not the record of a study"):
        studies.gather(tmp_path)


def test_a_study_that_began_otherwise_is_refused_before_an_address_is_told(finished, tmp_path, capsys):
    runs = tmp_path / "studies"
    Session(runs, study="anna").close()
    for options, said in (
        (["--task", "fp"], "task (pp, not fp)"),
        (["--noise", "0.25"], "noise (0.0, not 0.25)"),
        ([str(finished), "--noise", "0"], f"agent (oracle, not {finished.name})"),
    ):
        assert cli.main(["guide", *options, "--study", "anna", "--runs", str(runs), "--no-browser"]) == 2
        shown = capsys.readouterr()
        assert shown.out == "" and f"the study 'anna' has begun with another {said}" in shown.err
