"""What a cache holds: used only as it was written, and where nobody else can write."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from prescribed_motion import prescribed_motion

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


def _replaced_by(make):
    def damage(path):
        path.unlink()
        make(path)

    return damage


def _a_file_for_the_folder(path):
    shutil.rmtree(path.parent)
    path.parent.touch()


def _digest_of(path):
    return path.with_name(path.name + ".sha256")


DAMAGE = {
    "one bit": _flipped,
    "the last byte is missing": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "gone": Path.unlink,
    "others can write it": lambda path: path.chmod(0o666),
    "digest gone": lambda path: _digest_of(path).unlink(),
    "others can write the digest": lambda path: _digest_of(path).chmod(0o666),
    "a folder with a file": _replaced_by(lambda path: (path / "inner").mkdir(parents=True)),
    "a link to itself": _replaced_by(lambda path: path.symlink_to(path)),
    "a pipe": _replaced_by(os.mkfifo),
    "a device": _replaced_by(lambda path: path.symlink_to("/dev/zero")),
    "a file for the folder": _a_file_for_the_folder,
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
