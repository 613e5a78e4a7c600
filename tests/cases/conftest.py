"""The command, run inside the folder of a case."""

import pytest

from ballscrew.cli import main


@pytest.fixture
def command(capsys, monkeypatch):
    """``command(folder, words)``: exit code, and what is printed and what is said of errors."""

    def run(folder, words):
        monkeypatch.chdir(folder)
        return main(words.split()), *capsys.readouterr()

    return run
