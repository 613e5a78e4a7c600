"""What a cache holds: used only as it was written, and where nobody else can write."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from prescribed_motion import prescribed_motion

import ballscrew
from ballscrew.fmus import made_here
from ballscrew.orchestration.loop import catalogue
from ballscrew.plant.lugre import lugre
from ballscrew.solver import codegen, compilers, kernel_cache, stored, translation

NOBODY = 65534
FOLDERS = {
    "component": kernel_cache.COMPONENTS,
    "equations": kernel_cache.EQUATIONS,
    "fmu": kernel_cache.FMUS,
}


def motion():
    return prescribed_motion(lugre, "motion")


@pytest.fixture(scope="module")
def kernel():
    return codegen.generate(motion())


@pytest.fixture(scope="module")
def get(kernel):
    """What gets each kind of entry, from the cache or made, as something to compare."""

    def equations():
        assert translation.compile_equations(kernel.module, kernel.source, 1)
        return kernel_cache.compiled_path(kernel.module).read_bytes()

    def fmu():
        path = catalogue.fmu("relay")
        assert made_here.is_ours(path)
        return path.read_bytes()

    return {
        "component": lambda: stored.stored_kernel("motion", motion, "ballscrew.plant.lugre"),
        "equations": equations,
        "fmu": fmu,
    }


@pytest.fixture(scope="module")
def whole(get, tmp_path_factory):
    """A cache with a kernel's entry."""
    place = tmp_path_factory.mktemp("whole") / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BALLSCREW_CACHE", str(place))
        return place, get["component"]()


def _flipped(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def _in_place_of(make):
    def damage(path):
        path.unlink()
        make(path)

    return damage


def _in_place_of_the_folder(path):
    shutil.rmtree(path.parent)
    path.parent.touch()


DAMAGE = {
    "one bit": _flipped,
    "the last byte is missing": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "gone": Path.unlink,
    "others can write it": lambda path: path.chmod(0o666),
    "digest gone": lambda path: Path(f"{path}.sha256").unlink(),
    "others can write the digest": lambda path: Path(f"{path}.sha256").chmod(0o666),
    "a folder with a file": _in_place_of(lambda path: (path / "inner").mkdir(parents=True)),
    "a link to itself": _in_place_of(lambda path: path.symlink_to(path)),
    "a pipe": _in_place_of(os.mkfifo),
    "a device": _in_place_of(lambda path: path.symlink_to("/dev/zero")),
    "a file for the folder": _in_place_of_the_folder,
}
USUAL = [*DAMAGE][:5]
if os.getuid() == 0:
    DAMAGE["another user's"] = lambda path: os.chown(path, NOBODY, NOBODY)


def entry_of(kind, cache):
    there = (cache / FOLDERS[kind]).iterdir()
    return max(p for p in there if p.is_file() and p.suffix != ".sha256")


@pytest.mark.parametrize(
    "damage", [d if d in USUAL else pytest.param(d, marks=pytest.mark.ci) for d in DAMAGE]
)
def test_a_damaged_entry_is_made_anew(damage, whole, get, tmp_path, monkeypatch):
    place, found = whole
    cache = tmp_path / "cache"
    shutil.copytree(place, cache)
    monkeypatch.setenv("BALLSCREW_CACHE", str(cache))
    entry = entry_of("component", cache)
    kept = entry.read_bytes()
    DAMAGE[damage](entry)
    assert get["component"]() == found
    assert kernel_cache.read(entry) == kept
    before = entry.stat()
    assert get["component"]() == found
    assert entry.stat().st_ino == before.st_ino  # and from then on it is taken


@pytest.mark.ci
def test_only_the_user_can_open_what_is_made_whatever_the_umask(get, tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path / "above" / "cache"))
    before = os.umask(0)
    try:
        for make in get.values():
            make()
    finally:
        os.umask(before)
    made = [tmp_path / "above", *(tmp_path / "above").rglob("*")]
    assert len(made) > 10
    modes = {
        p.is_dir(): {stat.S_IMODE(q.stat().st_mode) for q in made if q.is_dir() == p.is_dir()}
        for p in made
    }
    assert modes == {True: {0o700}, False: {0o600}}


LOADED = """
import sys
from ballscrew.solver import kernel_cache
from ballscrew.solver.kernel import Kernel
kernel = Kernel.from_json(open(sys.argv[1]).read())
kernel.compile()
kernel.system()
print(kernel_cache.folder(), kernel_cache.compiled_path(kernel.module))
"""


@pytest.fixture
def load(kernel, above):
    """Let another process compile equations and load them: its cache, the library, its end."""
    text = above / "kernel.json"
    text.write_text(kernel.to_json())

    def run(cache):
        told = [sys.executable, "-c", LOADED, str(text)]
        environment = os.environ | {"BALLSCREW_CACHE": str(cache)}
        done = subprocess.run(told, env=environment, cwd=above, capture_output=True, text=True)
        return [Path(word) for word in done.stdout.split()], done.stderr, done.returncode

    return run


PLANTED = """#include <unistd.h>
__attribute__((constructor)) void f(void) { _exit(66); }
"""


@pytest.fixture
def above():
    """A folder as ``/tmp`` is; pytest's own may be another user's to write."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


UNSAFE = {
    "all can write the cache": (".", lambda path: path.chmod(0o777)),
    "a group can write a folder in it": ("equations", lambda path: path.chmod(0o770)),
    "all can write the folder above": ("..", lambda path: path.chmod(0o777)),
}
if os.getuid() == 0:
    UNSAFE["the cache belongs to another"] = (".", lambda path: os.chown(path, NOBODY, NOBODY))


@pytest.mark.ci
def test_a_library_in_a_cache_that_others_can_write_is_not_loaded(above, load):
    """In its place lies another with its digest, which is loaded where the cache is the user's."""
    bad = compilers.compile_library(compilers.own_platform(), {"e.c": PLANTED}, ["e.c"], "e")
    for k, (where, change) in enumerate([*UNSAFE.values(), (".", lambda path: None)]):
        cache = above / str(k) / "cache"
        (folder, library), said, code = load(cache)
        assert (folder, said, code) == (cache, "", 0)
        kernel_cache.write(library, bad)
        change(Path(os.path.normpath(cache / where)))
        told, said, code = load(cache)
        if k == len(UNSAFE):
            assert code == 66
            continue
        assert (code, len(said.splitlines())) == (0, 1)
        assert told[0] != cache
        assert said.startswith("note: the cache folder is not used: ")
        assert "BALLSCREW_CACHE" in said


# -- under what an entry is kept -----------------------------------------------------------------


def test_a_changed_source_of_the_equations_changes_the_hash_and_another_does_not(monkeypatch):
    names = "plant.axis", "plant.instruments.encoder"
    before = {m: stored.fingerprint(f"ballscrew.{m}") for m in names}
    stored.fingerprint.cache_clear()
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + b"#" * (p.name == "ball_screw.py"))
    after = {m: stored.fingerprint(f"ballscrew.{m}") for m in before}
    stored.fingerprint.cache_clear()
    assert after["plant.axis"] != before["plant.axis"]
    assert after["plant.instruments.encoder"] == before["plant.instruments.encoder"]


def test_components_that_a_list_names_are_found_too():
    assert "ballscrew.plant.dahl" in stored.sources_of("ballscrew.plant.law")


def test_equations_that_another_version_compiled_are_not_taken(monkeypatch):
    """Their struct may be another one: what holds it is not to be called."""
    before = kernel_cache.compiled_path("equations")
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + b"#" * (p.name == "system.h"))
    kernel_cache._way_of_compiling.cache_clear()
    after = kernel_cache.compiled_path("equations")
    kernel_cache._way_of_compiling.cache_clear()
    assert after != before


@pytest.mark.ci
def test_processes_that_start_with_one_empty_cache_agree_and_the_next_derives_nothing(tmp_path):
    run = (
        "import sys; from ballscrew.orchestration.loop.catalogue import fmu_kernel; "
        "from ballscrew.solver.kernel import Model; "
        "model = Model(fmu_kernel('plant'), {'v_start': 0.05}); model.kernel.compile(); "
        "model.advance(0.0, 0.05); print(model.x.tolist(), bool(model.kernel._compiled)); "
        "print('sympy' in sys.modules)"
    )

    def told(count):
        given = {"env": os.environ | {"BALLSCREW_CACHE": str(tmp_path)}, "cwd": tmp_path}
        command = [sys.executable, "-c", run]
        started = [
            subprocess.Popen(command, text=True, stdout=subprocess.PIPE, **given)
            for _ in range(count)
        ]
        return {process.communicate(timeout=300)[0] for process in started}

    (first,) = told(3)
    assert first.endswith(" True\nTrue\n")
    assert told(1) == {first.removesuffix("True\n") + "False\n"}


# -- without a home, from a package that cannot be written: as in containers ----------------------

# root becomes a user without a home folder, who can read everything and write nearly nothing
BECOME = f"setpriv --reuid {NOBODY} --regid {NOBODY} --clear-groups"
BECOME += " --inh-caps +dac_read_search --ambient-caps +dac_read_search"
AS_NOBODY = BECOME.split() if os.getuid() == 0 and shutil.which("setpriv") else []
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
