"""Commands for users without a home, from a package that they cannot write: as in containers."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import ballscrew

# root becomes a user without a home folder folder, who can read everything and write nearly nothing
NOBODY = "setpriv --reuid 65534 --regid 65534 --clear-groups"
NOBODY += " --inh-caps +dac_read_search --ambient-caps +dac_read_search"
AS_NOBODY = NOBODY.split() if os.getuid() == 0 and shutil.which("setpriv") else []
VARIABLES = ("BALLSCREW_CACHE", "MPLCONFIGDIR", "XDG_CACHE_HOME")
EVERYTHING = """
import importlib, pkgutil
import ballscrew
from ballscrew.cli import main
for module in pkgutil.walk_packages(ballscrew.__path__, "ballscrew."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
from pathlib import Path
from ballscrew.orchestration.loop.pictures import new_figure, write_figure
from ballscrew.solver import kernel_cache
code = main("export --only pid --out out".split())
write_figure(new_figure(1, 1, (2, 2))[0], Path("out"), "picture")
assert list((kernel_cache.folder() / "components").iterdir())  # kept in the private folder
print(code, kernel_cache.folder(), oct(kernel_cache.folder().stat().st_mode))
"""


@pytest.fixture
def place():
    """A folder that other users can read, too; pytest's own cannot be read by them."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    for name, mode in (("package", 0o755), ("work", 0o777), ("temporary", 0o1777)):
        (folder / name).mkdir()
        (folder / name).chmod(mode)
    yield folder
    shutil.rmtree(folder)


@pytest.mark.ci
def test_commands_work_with_no_folder_to_write_and_leave_nothing_behind(place):
    package = place / "package" / "ballscrew"
    source = Path(ballscrew.__file__).parent
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(p for p in package.rglob("*") if p.is_dir())):
        (folder / "__pycache__").touch()  # not even root can make a folder of this name then
    variables = {k: v for k, v in os.environ.items() if k not in VARIABLES}
    variables |= {"PYTHONPATH": str(place / "package"), "TMPDIR": str(place / "temporary")}
    variables |= {"PYTHONDONTWRITEBYTECODE": "1", "HOME": "/dev/null"}
    told = {"cwd": place / "work", "env": variables, "capture_output": True, "text": True}
    done = subprocess.run([*AS_NOBODY, sys.executable, "-c", EVERYTHING], **told)
    assert done.returncode == 0, done.stderr
    code, folder, mode = done.stdout.split()[-3:]
    assert code == "0"
    assert stat.S_IMODE(int(mode, 8)) == 0o700
    assert not Path(folder).exists()
    notes = [line for line in done.stderr.splitlines() if "BALLSCREW_CACHE" in line]
    assert len(notes) == 1
    assert notes[0].startswith("note: no cache folder can be written")
    assert "Traceback" not in done.stderr
    assert "atplotlib" not in done.stderr
    assert list((place / "temporary").iterdir()) == []
    assert [p.name for p in (place / "work").iterdir()] == ["out"]
    assert (place / "work" / "out" / "picture.png").exists()
