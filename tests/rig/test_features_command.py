"""``ballscrew features``: what it prints and writes, and how it ends."""

import argparse
import json
import subprocess
import sys

import pytest

from ballscrew import features_command
from ballscrew.options import BadRequest, Parser


def features(*arguments):
    """Exit code of the command; a bad request is raised as the command line's `main` gets it."""
    parser = Parser(prog="ballscrew")
    features_command.add_parser(parser.add_subparsers(parser_class=Parser), Parser)
    options = parser.parse_args(["features", *map(str, arguments)])
    return options.action(options)


def test_the_table_is_printed_and_the_figures_are_written(tmp_path, capsys):
    assert features("--laws", "dahl", "--out", tmp_path / "new") == 0
    printed = capsys.readouterr()
    assert "no (no)" in printed.out
    assert "lugre" not in printed.out
    assert printed.err == ""
    assert (tmp_path / "new" / "features.json").exists()
    assert len(list((tmp_path / "new").glob("figure_2_1*.png"))) == 6


def identified(path, law, **values):
    """A file as `ballscrew identify` writes it; what is None was not identified."""
    parameters = {
        name: {"value": 1.0 if value is None else value, "identified": value is not None}
        for name, value in values.items()
    }
    path.write_text(json.dumps({"law": law, "parameters": parameters}))
    return path


def test_identified_parameters_replace_nominal_ones_and_json_is_what_is_written(tmp_path, capsys):
    file = identified(tmp_path / "mine.json", "dahl", sigma=50e3, Fc=None)
    arguments = ("--laws", "dahl", "--identified", file, "--json", "--out", tmp_path / "out")
    assert features(*arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "features.json").read_text())
    assert list(printed["laws"]) == ["dahl"]
    written = printed["laws"]["dahl"]
    assert written["parameters"]["sigma"] == 50e3
    assert written["parameters"]["Fc"] != 1.0
    assert written["sources_of_parameters"]["sigma"] == "identified, mine.json"
    assert "Table 2" in written["sources_of_parameters"]["Fc"]


@pytest.mark.parametrize(
    ("content", "laws", "complaint"),
    [
        (None, (), "gone.json: No such file"),
        ("{", (), "is no identified.json, expected what `ballscrew identify` writes"),
        ("[]", (), "is no identified.json"),
        ('{"law": "dahl", "parameters": {"Fc": 1}}', (), "is no identified.json"),
        ('{"law": "dall", "parameters": {}}', (), "no friction law 'dall'; .*did you mean dahl"),
        ('{"law": "dahl", "parameters": {}}', ("lugre",), "is of dahl, which is not among --laws"),
        (
            '{"law": "dahl", "parameters": {"Fd": {"value": 1, "identified": true}}}',
            ("dahl",),
            "--identified: the rig with dahl has no 'plant.Fd'",
        ),
    ],
)
def test_a_file_that_is_not_of_an_identification_is_refused(content, laws, complaint, tmp_path):
    path = tmp_path / ("gone.json" if content is None else "given.json")
    if content is not None:
        path.write_text(content)
    chosen = ("--laws", *laws) if laws else ()
    with pytest.raises(BadRequest, match=complaint):
        features(*chosen, "--identified", path, "--out", tmp_path / "out")


def test_two_files_of_one_law_are_refused(tmp_path):
    files = [identified(tmp_path / name, "dahl") for name in ("a.json", "b.json")]
    with pytest.raises(BadRequest, match="another file is of dahl, too"):
        features("--identified", *files, "--out", tmp_path / "out")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--laws", "lugr", "--out", "x"], "no friction law 'lugr'; .*; did you mean lugre?"),
        (["--laws", "lugre"], "required: --out"),
        (["--laws", "--out", "x"], "expected at least one argument"),
    ],
)
def test_a_request_that_makes_no_sense_is_answered_in_one_line(arguments, complaint, tmp_path):
    wanted = [str(tmp_path / a) if a == "x" else a for a in arguments]
    with pytest.raises(BadRequest, match=complaint):
        features(*wanted)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadRequest, match="is a file, expected a folder"):
        features("--out", tmp_path / "file")


def test_help_loads_nothing_heavy():
    code = (
        "import argparse, sys\n"
        "from ballscrew.features_command import add_parser\n"
        "p = argparse.ArgumentParser()\n"
        "add_parser(p.add_subparsers(), argparse.ArgumentParser)\n"
        "p.parse_args(['features', '--out', 'x'])\n"
        "print([m for m in ('numpy', 'scipy', 'sympy') if m in sys.modules])\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_help_shows_examples():
    parser = Parser(prog="ballscrew")
    features_command.add_parser(parser.add_subparsers(parser_class=Parser), Parser)
    (commands,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    assert "ballscrew features --out out/features" in commands.choices["features"].format_help()
