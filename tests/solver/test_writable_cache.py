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
from ballscrew.orchestration.pictures import new_figure, write_figure
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
    (folder / "package").mkdir()
    (folder / "work").mkdir()
    (folder / "work").chmod(0o777)
    (folder / "temporary").mkdir()
    (folder / "temporary").chmod(0o1777)  # as /tmp is: nobody replaces what is another's
    yield folder
    shutil.rmtree(folder)


def run(place, *arguments):
    variables = {k: v for k, v in os.environ.items() if k not in VARIABLES}
    variables |= {"PYTHONPATH": str(place / "package"), "TMPDIR": str(place / "temporary")}
    variables |= {"PYTHONDONTWRITEBYTECODE": "1", "HOME": "/dev/null"}
    return subprocess.run(
        arguments,
        capture_output=True,
        text=True,
        cwd=place / "work",
        env=variables,
    )


def test_commands_work_with_no_folder_to_write_and_leave_nothing_behind(place):
    package = place / "package" / "ballscrew"
    source = Path(ballscrew.__file__).parent
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(p for p in package.rglob("*") if p.is_dir())):
        (folder / "__pycache__").touch()  # not even root can make a folder of this name then
    done = run(place, *AS_NOBODY, sys.executable, "-c", EVERYTHING)
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


def test_a_user_without_a_home_is_told_which_variable_to_set(place):
    code = "from ballscrew.solver import kernel_cache; print(kernel_cache.folder())"
    nobody = "import pathlib\ndef none(*_): raise RuntimeError\npathlib.Path.home = none\n"
    done = run(place, sys.executable, "-c", nobody + code)
    assert Path(done.stdout.strip()).parent == place / "temporary"
    assert "set BALLSCREW_CACHE" in done.stderr
