"""What a cache holds: used only as it was written, and where nobody else can write."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from prescribed_motion import prescribed_motion

import ballscrew
from ballscrew.fmus import made_here, source_fmu
from ballscrew.orchestration.loop import catalogue
from ballscrew.plant.lugre import lugre
from ballscrew.solver import codegen, compilers, kernel_cache, stored, translation

NOBODY = 65534
FOLDERS = {
    "component": kernel_cache.COMPONENTS,
    "equations": kernel_cache.EQUATIONS,
    "sources": kernel_cache.COMPILED,
    "fmu": kernel_cache.FMUS,
    "note": kernel_cache.MADE,
}


def motion():
    return prescribed_motion(lugre, "motion")


@pytest.fixture(scope="module")
def kernel():
    return codegen.generate(motion())


@pytest.fixture(scope="module")
def get(kernel, tmp_path_factory):
    """What gets each kind of entry, from the cache or made, as something to compare."""
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "sources").mkdir()
    (folder / "sources" / "model.c").write_text("int answer(void) { return 42; }\n")
    files = SimpleNamespace(
        language="C99", preprocessorDefinitions=[], includeDirectories=[], sourceFiles=["model.c"]
    )
    build = SimpleNamespace(modelIdentifier="model", sourceFileSets=[files])

    def sources():
        source_fmu.compile_sources(folder, build, "binaries/model")
        return (folder / "binaries" / "model").read_bytes()

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
        "sources": sources,
        "fmu": fmu,
        "note": fmu,
    }


@pytest.fixture(scope="module")
def whole(get, tmp_path_factory):
    """A cache with a kernel's entry."""
    place = tmp_path_factory.mktemp("whole") / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BALLSCREW_CACHE", str(place))
        return place, get["component"]()


def _rewritten(change):
    def damage(path):
        path.write_bytes(change(path.read_bytes()))

    return damage


def _in_place_of_it(make):
    def damage(path):
        path.unlink()
        make(path)

    return damage


def _folder_replaced(make):
    def damage(path):
        shutil.rmtree(path.parent)
        make(path.parent)

    return damage


def _flipped(data):
    middle = len(data) // 2
    return data[:middle] + bytes(b ^ 1 for b in data[middle : middle + 1]) + data[middle + 1 :]


def _with_a_file(path):
    path.mkdir()
    (path / "file").touch()


def _beside(damage):
    return lambda path: damage(path.with_name(path.name + ".sha256"))


DAMAGE = {
    "one bit": _rewritten(_flipped),
    "the last byte is missing": _rewritten(lambda data: data[:-1]),
    "empty": _rewritten(lambda data: b""),
    "gone": Path.unlink,
    "a folder with a file": _in_place_of_it(_with_a_file),
    "a link to itself": _in_place_of_it(lambda path: path.symlink_to(path)),
    "a pipe": _in_place_of_it(os.mkfifo),
    "a device": _in_place_of_it(lambda path: path.symlink_to("/dev/zero")),
    "others can write it": lambda path: path.chmod(0o666),
    "digest gone": _beside(Path.unlink),
    "digest of nothing else": _beside(_rewritten(_flipped)),
    "others can write the digest": _beside(lambda path: path.chmod(0o666)),
    "no folder": _folder_replaced(lambda folder: None),
    "a file for the folder": _folder_replaced(Path.touch),
}
USUAL = "one bit", "the last byte is missing", "gone", "others can write it", "digest gone"
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
@pytest.mark.parametrize("kind", [k for k in FOLDERS if k != "component"])
def test_an_entry_of_each_kind_is_made_anew(kind, get, tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path / "cache"))
    found = get[kind]()
    entry = entry_of(kind, tmp_path / "cache")
    kept = entry.read_bytes()
    _rewritten(_flipped)(entry)
    assert get[kind]() == found
    assert kernel_cache.read(entry) == kept


@pytest.mark.ci
def test_only_the_user_can_open_what_is_made_whatever_the_umask(get, tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path / "above" / "cache"))
    before = os.umask(0)
    try:
        for kind in ("component", "equations", "fmu"):
            get[kind]()
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
def planted(above, load):
    """A cache in which the equations' library is another, with its digest."""
    cache = above / "own" / "cache"
    (folder, library), said, code = load(cache)
    assert (folder, said, code) == (cache, "", 0)
    bad = compilers.compile_library(compilers.own_platform(), {"e.c": PLANTED}, "e.c", "e")
    kernel_cache.write(library, bad)
    return cache


@pytest.fixture
def above():
    """A folder as ``/tmp`` is; pytest's own may be another user's to write."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def _all_can_write(path):
    path.chmod(0o777)


UNSAFE = {
    "all can write the cache": (".", _all_can_write),
    "a group can write a folder in it": ("equations", lambda path: path.chmod(0o770)),
    "all can write the folder above": ("..", _all_can_write),
}
if os.getuid() == 0:
    UNSAFE["the cache belongs to another"] = (".", lambda path: os.chown(path, NOBODY, NOBODY))


@pytest.mark.ci
@pytest.mark.parametrize("how", UNSAFE)
def test_a_library_in_a_cache_that_others_can_write_is_not_loaded(how, planted, load):
    where, change = UNSAFE[how]
    change(Path(os.path.normpath(planted / where)))
    (folder, _), said, code = load(planted)
    assert code == 0
    assert folder != planted
    assert len(said.splitlines()) == 1
    assert said.startswith("note: the cache folder is not used: ")
    assert "BALLSCREW_CACHE" in said


@pytest.mark.ci
def test_a_library_in_the_users_own_cache_is_loaded(planted, load):
    """Else the tests above would prove nothing."""
    assert load(planted)[2] == 66


@pytest.mark.ci
def test_a_library_that_was_cut_short_ends_no_process(planted, load):
    (library,) = (planted / "equations").glob("*.so")
    with library.open("r+b") as stream:
        stream.truncate(library.stat().st_size // 2)  # the loader would meet SIGBUS
    (folder, _), said, code = load(planted)
    assert (folder, said, code) == (planted, "", 0)


# -- under what an entry is kept -----------------------------------------------------------------


def test_a_changed_source_of_the_equations_changes_the_hash_and_another_does_not(monkeypatch):
    names = "plant.axis", "instruments.encoder"
    before = {m: stored.fingerprint(f"ballscrew.{m}") for m in names}
    stored.fingerprint.cache_clear()
    read = type(stored._TOP).read_bytes

    def changed(path):
        return read(path) + b"#" * (path.name == "ball_screw.py")

    monkeypatch.setattr(type(stored._TOP), "read_bytes", changed)
    after = {m: stored.fingerprint(f"ballscrew.{m}") for m in before}
    stored.fingerprint.cache_clear()
    assert after["plant.axis"] != before["plant.axis"]
    assert after["instruments.encoder"] == before["instruments.encoder"]


def test_components_that_a_list_names_are_found_too():
    assert "ballscrew.plant.dahl" in stored.sources_of("ballscrew.plant.law")


PLACE = "from ballscrew.solver.kernel_cache import compiled_path; print(compiled_path('equations'))"


@pytest.mark.ci
def test_equations_that_another_version_compiled_are_not_taken(tmp_path):
    """Their struct may be another one: what holds it is not to be called."""
    package = tmp_path / "ballscrew"
    shutil.copytree(Path(ballscrew.__file__).parent, package)

    def place():
        environment = os.environ | {"PYTHONPATH": str(tmp_path), "BALLSCREW_CACHE": str(tmp_path)}
        told = [sys.executable, "-c", PLACE]
        return subprocess.run(
            told, env=environment, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout

    before = place()
    assert place() == before
    with (package / "solver" / "c" / "system.h").open("a") as header:
        header.write("/* another version */\n")
    assert place() != before


@pytest.mark.ci
def test_a_second_process_does_not_derive_again(tmp_path):
    run = (
        "import sys; from ballscrew.orchestration.loop.catalogue import fmu_kernel; "
        "from ballscrew.solver.kernel import Model; Model(fmu_kernel('plant')).advance(0.0, 1e-3); "
        "print('sympy' in sys.modules)"
    )
    told = {"env": os.environ | {"BALLSCREW_CACHE": str(tmp_path)}, "cwd": tmp_path}
    for derives in ("True", "False"):
        done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, **told)
        assert done.stdout.strip() == derives, done.stderr
