"""Journals grow by whole lines; a torn last line is passed over, any other broken one refused."""

import pytest

from usbench.records.journal import Journal, append_all, read_rows

ROWS = [{"episode": 0, "return": -12.5, "actions": [0, 1]}, {"episode": 1, "steps_to_goal": None}]


@pytest.fixture
def path(tmp_path):
    with Journal(tmp_path / "rows.jsonl") as journal:
        journal.append(ROWS)
    return tmp_path / "rows.jsonl"


def test_rows_come_back_and_later_ones_join_them(path):
    assert read_rows(path) == ROWS
    with Journal(path) as journal:
        journal.append(iter(ROWS[:1]))
        # Flushed: there before the file is closed.
        assert read_rows(path) == [*ROWS, ROWS[0]]


def test_a_file_that_is_not_there_has_no_rows(tmp_path):
    assert read_rows(tmp_path / "nothing.jsonl") == []


def test_torn_last_line_is_passed_over(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:-7])
    assert read_rows(path) == ROWS[:1]
    path.write_bytes(whole + b'{"episode": 2')
    assert read_rows(path) == ROWS


@pytest.mark.parametrize("line", [b"{broken\n", b"[1]\n", b"\xff\n", b"[" * 100_000 + b"\n"])
def test_broken_line_in_between_is_refused(path, line):
    path.write_bytes(line + path.read_bytes())
    with pytest.raises(ValueError, match="line 1"):
        read_rows(path)


def test_file_that_does_not_fit_into_the_memory_is_refused(path, monkeypatch):
    monkeypatch.setattr(type(path), "read_bytes", lambda _: bytes(1 << 62))
    with pytest.raises(ValueError, match=f"^{path} is not a record: it does not fit into the memory.$"):
        read_rows(path)


def test_not_a_number_never_enters_a_journal(path):
    with Journal(path) as journal, pytest.raises(ValueError, match="float"):
        journal.append([{"return": float("nan")}])
    assert read_rows(path) == ROWS


def test_journal_is_cut_back_to_a_mark_and_goes_on(path):
    with Journal(path) as journal:
        mark = journal.mark()
        assert mark["bytes"] == path.stat().st_size
        journal.append(ROWS[:1])
    with path.open("ab") as file:
        file.write(b'{"torn')
    with Journal(path) as journal:
        journal.cut(mark)
        assert journal.mark() == mark
        journal.append(ROWS[1:])
    assert read_rows(path) == [*ROWS, ROWS[1]]


@pytest.mark.parametrize("change", [lambda content: content[:-1], lambda content: b"#" + content[1:]])
def test_journal_that_is_not_what_was_marked_is_refused_and_left_alone(path, change):
    with Journal(path) as journal:
        mark = journal.mark()
    changed = change(path.read_bytes()) + b"{}\n"
    path.write_bytes(changed)
    with Journal(path) as journal, pytest.raises(ValueError, match="is not what its trial wrote"):
        journal.cut(mark)
    assert path.read_bytes() == changed


def test_rows_are_added_all_or_none_where_the_disk_is_full(tmp_path):
    path = tmp_path / "new.jsonl"
    resource = pytest.importorskip("resource")  # not on Windows
    append_all(path, [{"a": 1}])
    before, (soft, hard) = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 12, hard))
    try:
        with pytest.raises(OSError):
            append_all(path, [{"a": 2}, {"a": 3}])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
    append_all(path, [{"a": 2}])
    assert read_rows(path) == [{"a": 1}, {"a": 2}]
