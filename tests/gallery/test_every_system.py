"""Each system of the gallery: its page holds what it computes, and its commands run."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.gallery import SYSTEMS
from ballscrew.gallery.finding import BEGIN, END, Finding, table_of

ROOT = Path(__file__).resolve().parents[2]
PAGES = {name: (ROOT / "gallery" / name / "page.md").read_text("utf-8") for name in SYSTEMS}
KINDS = ("export", "run", "lyapunov", "map")


def commands(page):
    return re.findall(r"^ballscrew (.+)$", page, re.M)


def cells(table):
    return [[c.strip() for c in line.strip("|").split("|")] for line in table.strip().splitlines()]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=pytest.mark.xdist_group(f"gallery {name}")) for name in SYSTEMS
    ],
)
def shown(request, tmp_path_factory, drawing):
    """A system, and the folder that the command wrote of it."""
    folder = tmp_path_factory.mktemp(request.param)
    with drawing():
        assert main(["gallery", request.param, "--out", str(folder)]) == 0
    return request.param, folder


def test_the_list_names_every_folder_that_is_there(capsys):
    folders = {p.parent.name for p in (ROOT / "gallery").glob("*/components.py")}
    assert folders == set(SYSTEMS)
    assert main(["gallery"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SYSTEMS)
    assert max(map(len, lines)) <= 110


def test_the_page_prints_the_numbers_that_are_computed(shown):
    """To a unit of the last digit that it prints, since round-off differs between machines."""
    name, folder = shown
    printed = cells(PAGES[name].partition(BEGIN)[2].partition(END)[0])[2:]
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    found = [Finding(**{k: v for k, v in row.items() if k != "agrees"}) for row in rows]
    assert len(found) >= 3
    now = cells(table_of(found))[2:]
    for row, f, fresh in zip(printed, found, now, strict=True):
        ours = row.pop(1)
        fresh.pop(1)
        assert row == fresh
        value = float(ours.split()[0])
        assert value == pytest.approx(f.ours, rel=2e-5, abs=1e-12), f.what


def test_the_command_writes_what_it_says(shown):
    _, folder = shown
    written = {p.name for p in folder.iterdir()}
    assert {"components.py", "page.md", "findings.json", "picture.png"} <= written
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    for row in rows:
        assert row["source"], row["what"]  # where it is printed, or how ours is checked
        assert row["agrees"] is not False or row["remark"], row["what"]  # a difference is explained


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)])
def test_the_page_has_one_command_for_each_way_of_looking_and_they_run(
    shown, whole, tmp_path, monkeypatch
):
    """If not as a whole: a tenth of each motion, and the corners of the map."""
    name, folder = shown
    monkeypatch.chdir(folder)
    asked = [shlex.split(c) for c in commands(PAGES[name]) if not c.startswith("gallery")]
    assert {words[0] for words in asked} >= set(KINDS)
    for words in asked:
        words[words.index("--out") + 1] = str(tmp_path / words[0])
        if not whole:
            if words[0] == "map":
                words += ["--workers", "1"]
            words[:] = [re.sub(r"^(.+=.+:.+):\d+$", r"\1:2", word) for word in words]
            if "--stop" in words:
                stop = words.index("--stop") + 1
                words[stop] = str(float(words[stop]) / 10)
        assert main(words) in (0, 1), words


def test_the_gallery_begins_with_six_pictures_that_link_to_its_pages():
    page = (ROOT / "docs" / "gallery" / "index.md").read_text("utf-8")
    shown = re.findall(
        r"^\[!\[.+\]\(\.\./(images/gallery/(\w+)\.png)\)\]\((\w+)\.md\)$", page, re.M
    )
    assert len({picture for picture, _, _ in shown}) == 6
    for picture, name, page in shown:
        assert name == page
        assert (ROOT / "docs" / picture).is_file()
        assert (ROOT / "docs" / "gallery" / f"{page}.md").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["van_der_pool", "--out", "x"], "did you mean van_der_pol"),
        (["van_der_pol"], "--out is missing"),
        (["--out", "x"], "give its NAME"),
    ],
)
def test_a_request_that_makes_no_sense_gets_one_line(arguments, said, capsys):
    assert main(["gallery", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_number_agrees_within_a_digit_of_what_is_printed_and_only_then():
    near = Finding("x", 2.0149, "1", "a text", 2.0148, 1e-4)
    assert near.agrees
    assert not Finding("x", 2.0150, "1", "a text", 2.0148, 1e-4).agrees
    assert Finding("x", 2.0, "1", "a text", np.float64(2.0)).agrees is True  # JSON knows no other
    assert Finding("x", 2.0, "1", "another solver").agrees is None
    assert "| x | 2.0149 | 2.0148 | yes | a text |" in table_of([near])
