"""Words on the leaderboard's figures say of which tasks they are, and each part's stand in its section."""

import pytest
from made_tables import made, seeds, trial

from usbench.results import captions, leaderboard, scores, tables

PAPERS = [row for task in ("fp", "pp") for row in seeds("vpg", [0.5, 0.6], task=task)]
OTHERS = [row for task in ("exam", "setup") for row in seeds("vpg", [0.3, 0.4], task=task)]
UNSEEN = [
    row for task in ("pp-random", "pp-tracked") for row in seeds("dqn", [0.7], task=task, steps=100_000)
]
KINDS = ("scores", "learning_curves", "learning_curves_cpu")


def draw(known, folder, kinds=KINDS):
    """Lay empty files where the figures of each part belong."""
    folder.mkdir(exist_ok=True)
    for part in scores.parts(known):
        for kind in kinds:
            (folder / f"{scores.prefix(part)}{kind}.png").write_bytes(b"")


@pytest.mark.parametrize(
    ("trials", "words"),
    [
        (PAPERS, ["the paper's tasks"]),
        (PAPERS[:2], ["fp"]),
        (OTHERS, ["exam and setup"]),
        (PAPERS + OTHERS, ["the paper's tasks", "exam and setup"]),
        (UNSEEN, ["pp-random and pp-tracked"]),
        (PAPERS + UNSEEN, ["the paper's tasks", "the table unseen-phantoms"]),
        ([trial("oracle", 1.0, task="exam")], ["exam"]),
        # A reference policy learns on no task.
        ([*PAPERS, trial("oracle", 1.0, task="exam")], ["the paper's tasks"]),
    ],
    ids=[
        "paper",
        "one of the paper's",
        "others",
        "both",
        "unseen alone",
        "grid and unseen",
        "references",
        "reference elsewhere",
    ],
)
def test_words_follow_the_tasks_of_the_trials(trials, words, tmp_path):
    known = made(*trials)
    draw(known, tmp_path)
    links = captions.links(known, tmp_path, "files")
    assert [own[0].partition("![")[2].partition(", with its interval]")[0] for own in links.values()] == [
        f"Score of every agent in every cell of {where}" for where in words
    ]


def test_only_what_is_drawn_is_linked(tmp_path):
    known = made(*PAPERS, *OTHERS)
    draw(known, tmp_path, ["learning_curves"])
    first, second = captions.links(known, tmp_path, "files").values()
    assert first == [
        "![Score over training steps in every cell of the paper's tasks, with its interval]"
        "(files/learning_curves.png)"
    ]
    assert len(second) == 1 and second[0].endswith("(files/other_learning_curves.png)")


def test_a_link_ends_where_it_should_however_the_leaderboard_is_named(tmp_path):
    known = made(*PAPERS)
    draw(known, tmp_path, ["learning_curves"])
    (((link,),)) = captions.links(known, tmp_path, "my (old) board_files").values()
    assert link.endswith("](my%20%28old%29%20board_files/learning_curves.png)")


def test_figures_of_the_first_part_stand_on_top_and_others_in_their_sections(tmp_path):
    known = made(*PAPERS, *OTHERS, *UNSEEN)
    tables.write(known, tmp_path / "board_files")
    draw(known, tmp_path / "board_files")
    text = leaderboard.write(tmp_path / "board_files", tmp_path / "board.md")[0].read_text()
    top, *sections = text.split("\n## ")
    found = {own.partition("\n")[0]: own for own in sections if "![" in own}
    assert list(found) == ["The other tasks together", "Further table: unseen-phantoms"]
    for own, prefix in zip((top, *found.values()), ("", "other_", "unseen-phantoms_"), strict=True):
        assert [f"(board_files/{prefix}{kind}.png)" in own for kind in KINDS] == [True] * 3
        assert own.count("![") == 3
        # CPU time is folded.
        before = own.partition(f"{prefix}learning_curves_cpu.png")[0]
        assert before.count("<details>") == before.count("</details>") + 1
