"""What a hostile FMU can do without a sandbox, it cannot do in one; and the run is the same."""

import pytest
from hostile_fmu import needs_sandbox, world
from third_party_fmus import proportional

from ballscrew.cli import main
from ballscrew.fmus import sandbox

pytestmark = pytest.mark.ci  # needs bubblewrap


def run(path, out, *more):
    asked = ["run", "--controller", path, "--stop", "0.005", "--step", "1e-4", "--out", out, *more]
    return main(list(map(str, asked)))


def test_in_a_sandbox_it_does_nothing_and_the_run_is_the_same(tmp_path, monkeypatch):
    needs_sandbox()
    with world(tmp_path, monkeypatch) as user:
        out = user.folders["out"]
        assert run(user.hostile("hostile.act()"), out, "--sandbox") == 0
        found = (out / "trajectory.csv").read_text()
        assert user.harm() == set()
        innocent = out.with_name("innocent")
        assert run(user.hostile("pass", "Innocent"), innocent) == 0
        assert (innocent / "trajectory.csv").read_text() == found
        assert run(user.hostile("hostile.act()"), out) == 0
        assert user.harm() == {"tells", "kills", "home", "out", "here", "temporary"}


def test_without_bubblewrap_the_line_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: None)
    assert run(proportional(tmp_path, "Any"), tmp_path / "out", "--sandbox") == 2
    heard = capsys.readouterr().err
    assert "bwrap (bubblewrap) was not found; install it, as by `apt install" in heard
    assert heard.count("\n") == 1
