"""A folder holds the old run or the new one, whole, whenever a process is killed."""

import json
import os
import shutil

import pytest

from ballscrew.orchestration.loop.run_folder import HIDDEN, settle, write_run

OLD = {"table.csv": "old table", "phase.png": "old phase", "one/record.csv": "old record"}
NEW = {"table.csv": "new table", "figures.json": "new figures", "two/record.csv": "new record"}
THEIRS = {"notes.txt": "mine", "one/mine.txt": "mine, too", "figures.json": "mine of that name"}
MOVED = {("figures.json.kept" if n == "figures.json" else n): t for n, t in THEIRS.items()}


class Killed(BaseException):
    """In place of the signal, at an instant of our choice."""


def put(files):
    def write(folder):
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)

    return write


def held(folder):
    """Everything that a user sees."""
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and HIDDEN not in path.parts
    }


@pytest.fixture
def used(tmp_path):
    """A folder with an earlier run and files of the user's."""
    folder = tmp_path / "out"
    assert write_run(folder, put(OLD)) == []
    put(THEIRS)(folder)
    return folder


def test_the_results_of_a_run_take_the_place_of_the_last_and_the_users_files_stay(used):
    notes = write_run(used, put(NEW))
    assert held(used) == NEW | MOVED
    assert len(notes) == 1
    assert "figures.json" in notes[0]


def test_a_folder_and_a_link_and_a_file_in_a_results_place_stay(tmp_path):
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    (tmp_path / "out" / "two").write_text("a file where a folder goes")
    (tmp_path / "elsewhere").write_text("mine")
    (tmp_path / "out" / "figures.json").symlink_to(tmp_path / "elsewhere")
    write_run(tmp_path / "out", put(NEW))
    assert (tmp_path / "out" / "table.csv").read_text() == "new table"
    assert (tmp_path / "out" / "table.csv.kept").is_dir()
    assert (tmp_path / "out" / "two.kept").read_text() == "a file where a folder goes"
    assert (tmp_path / "out" / "figures.json.kept").is_symlink()
    assert (tmp_path / "elsewhere").read_text() == "mine"


def test_what_is_added_belongs_to_the_run_that_is_there(used):
    write_run(used, put({"borders.csv": "b"}), adds=True)
    assert held(used) == OLD | THEIRS | {"borders.csv": "b"}
    write_run(used, put(NEW))
    assert held(used) == NEW | MOVED


def test_a_folder_of_others_removes_nothing_behind_its_links(used, tmp_path):
    """Its list names a file of the user's, with the right digest, by a link."""
    other = tmp_path / "other"
    (other / "next").mkdir(parents=True)
    (other / "mine.txt").write_text(OLD["table.csv"])
    (used / "away").symlink_to(other)
    listed = used / HIDDEN / "written.json"
    files = json.loads(listed.read_text())
    listed.write_text(json.dumps(files | {"away/mine.txt": files["table.csv"]}))
    write_run(used, put(NEW))
    assert (other / "mine.txt").read_text() == OLD["table.csv"]
    shutil.rmtree(used / HIDDEN)
    (used / HIDDEN).symlink_to(other)
    for action in (settle, lambda folder: write_run(folder, put(NEW))):
        with pytest.raises(OSError, match="a link, expected a folder"):
            action(used)
    assert (other / "next").is_dir()


@pytest.mark.parametrize("text", ["", "[1]", '{"../notes.txt": "0", "/etc/hosts": "0", "a": 1}'])
def test_a_damaged_list_removes_nothing(used, text):
    (used / HIDDEN / "written.json").write_text(text)
    write_run(used, put(NEW))
    assert held(used) == OLD | NEW | MOVED | {"table.csv.kept": OLD["table.csv"]}


@pytest.mark.ci
def test_whatever_call_is_the_last_the_folder_holds_one_run_after_the_next_start(
    used, tmp_path, monkeypatch
):
    """Each call that changes the disk, in turn, is the one before or at which all ends."""
    calls = [(os, n) for n in ("replace", "rename", "unlink", "mkdir", "rmdir", "open")]
    originals = {name: getattr(module, name) for module, name in calls}
    outcomes = []
    for last in range(1000):
        folder = tmp_path / f"copy{last}"
        shutil.copytree(used, folder)
        left = [last]

        def counted(name, left=left):
            def call(*arguments, **options):
                if left[0] == 0:
                    raise Killed
                left[0] -= 1
                return originals[name](*arguments, **options)

            return call

        with monkeypatch.context() as patched:
            for module, name in calls:
                patched.setattr(module, name, counted(name))
            try:
                write_run(folder, put(NEW))
                killed = False
            except Killed:
                killed = True
        settle(folder)
        seen = held(folder)
        assert seen in (OLD | THEIRS, NEW | MOVED)
        outcomes.append("old" if seen == OLD | THEIRS else "new")
        assert settle(folder) == []
        if not killed:
            break
    assert outcomes == sorted(outcomes, reverse=True)  # old up to one instant, new from then on
    assert outcomes.count("old") > 5
    assert outcomes.count("new") > 5
