"""What a hostile FMU can do, and that it can do nothing under the recipe of docs/security.md."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hostile_fmu import world

PAGE = Path(__file__).resolve().parents[1] / "docs" / "security.md"
ASKED = "ballscrew run --controller theirs.fmu --out out"


@pytest.mark.ci
def test_under_the_lines_of_the_page_a_hostile_fmu_harms_nobody(tmp_path, monkeypatch):
    if not shutil.which("bwrap"):
        pytest.skip("needs bubblewrap (`apt install bubblewrap`), for the recipe of security.md")
    (lines,) = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert ASKED in lines
    monkeypatch.setenv("PATH", f"{sys.prefix}/bin", prepend=":")
    with world(tmp_path, monkeypatch) as user:
        here = user.folders["here"]

        def run(script, report):
            theirs = user.hostile(f"hostile.act({str(report)!r})", report.parent.name.title())
            shutil.copy(theirs, here / "theirs.fmu")
            subprocess.run(["sh", "-euc", script], check=True, capture_output=True)
            return (here / "out" / "trajectory.csv").read_text()

        short = f"{ASKED} --stop 0.005 --step 1e-4"
        found = run(lines.replace(ASKED, short), Path("/home/axis/report"))
        assert user.harm() == set()
        assert not (here / "report").exists()  # nothing was done inside either
        report = user.folders["temporary"] / "report"
        assert run(short, report) == found
        assert user.harm() == {"tells", "kills", *user.folders}
        words = report.read_text().split()
        assert {"tells", "reads", "lists", "kills", "knows", *user.folders} <= set(words)
