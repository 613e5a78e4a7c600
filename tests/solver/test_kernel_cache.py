"""What a cache holds: used only as it was written, and where nobody else can write."""

import os
import shutil
import socket
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from prescribed_motion import prescribed_motion

from ballscrew.fmus import catalogue, export, made_here, reference_files, source_fmu
from ballscrew.fmus.native import ready
from ballscrew.plant.lugre import lugre
from ballscrew.solver import codegen, compiled_equations, compilers, kernel_cache, stored

NOBODY = 65534
FOLDERS = {
    "component": kernel_cache.COMPONENTS,
    "equations": kernel_cache.EQUATIONS,
    "reference": kernel_cache.REFERENCES,
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
        language="C99",
        preprocessorDefinitions=[],
        includeDirectories=[],
        sourceFiles=["model.c"],
    )
    build = SimpleNamespace(modelIdentifier="model", sourceFileSets=[files])

    def sources():
        source_fmu.compile_sources(folder, build, "binaries/model")
        return (folder / "binaries" / "model").read_bytes()

    def equations():
        assert compiled_equations.compile_equations(kernel.module, kernel.source, 1)
        return kernel_cache.compiled_path(kernel.module).read_bytes()

    def fmu():
        path = catalogue.fmu("relay")
        assert made_here.is_ours(path)
        return path.read_bytes()

    return {
        "component": lambda: stored.stored_kernel("motion", motion, "ballscrew.plant.lugre"),
        "equations": equations,
        "reference": lambda: reference_files.reference_files(kernel),
        "sources": sources,
        "fmu": fmu,
        "note": fmu,
    }


@pytest.fixture(scope="module")
def whole(get, tmp_path_factory):
    """A cache with an entry of each kind, and what the slow steps of making them gave."""
    place = tmp_path_factory.mktemp("whole") / "cache"
    made = {}

    def noted(name, function, read=lambda result: result):
        def call(*arguments):
            result = function(*arguments)
            made[name] = read(result)
            return result

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BALLSCREW_CACHE", str(place))
        slow = compiled_equations.compile_library, source_fmu.compile_in, export._build
        patch.setattr(compiled_equations, "compile_library", noted("equations", slow[0]))
        patch.setattr(source_fmu, "compile_in", noted("sources", slow[1]))
        patch.setattr(export, "_build", noted("fmu", slow[2], Path.read_bytes))
        found = {kind: get[kind]() for kind in FOLDERS}
    return place, found, made


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


def _linked_to_another(path):
    other = path.with_name("another")
    path.rename(other)
    path.symlink_to(other)


def _socket(path):
    with socket.socket(socket.AF_UNIX) as bound:
        before = Path.cwd()
        os.chdir(path.parent)  # the name of a socket is short
        try:
            bound.bind(path.name[:8])
        finally:
            os.chdir(before)
    path.with_name(path.name[:8]).rename(path)


def _beside(damage):
    return lambda path: damage(path.with_name(path.name + ".sha256"))


DAMAGE = {
    "half of it": _rewritten(lambda data: data[: len(data) // 2]),
    "the last byte is missing": _rewritten(lambda data: data[:-1]),
    "empty": _rewritten(lambda data: b""),
    "zeros": _rewritten(lambda data: bytes(len(data))),
    "one bit": _rewritten(_flipped),
    "more at the end": _rewritten(lambda data: data + b"\n"),
    "another text": _rewritten(lambda data: b"{}"),
    "random bytes": _rewritten(lambda data: os.urandom(max(1, len(data)))),
    "gone": Path.unlink,
    "a folder": _in_place_of_it(Path.mkdir),
    "a folder with a file": _in_place_of_it(_with_a_file),
    "a link to nothing": _in_place_of_it(lambda path: path.symlink_to("nothing")),
    "a link to itself": _in_place_of_it(lambda path: path.symlink_to(path)),
    "a link to another file": _linked_to_another,
    "a pipe": _in_place_of_it(os.mkfifo),
    "a socket": _in_place_of_it(_socket),
    "a device": _in_place_of_it(lambda path: path.symlink_to("/dev/zero")),
    "others can write it": lambda path: path.chmod(0o666),
    "digest gone": _beside(Path.unlink),
    "digest empty": _beside(_rewritten(lambda data: b"")),
    "digest of nothing else": _beside(_rewritten(_flipped)),
    "digest a folder": _beside(_in_place_of_it(_with_a_file)),
    "digest a link to nothing": _beside(_in_place_of_it(lambda path: path.symlink_to("nothing"))),
    "others can write the digest": _beside(lambda path: path.chmod(0o666)),
    "no folder": _folder_replaced(lambda folder: None),
    "a file for the folder": _folder_replaced(Path.touch),
    "the folder a link to nothing": _folder_replaced(lambda path: path.symlink_to("nothing")),
}
if os.getuid() == 0:
    DAMAGE["another user's"] = lambda path: os.chown(path, NOBODY, NOBODY)


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("kind", FOLDERS)
def test_a_damaged_entry_is_made_anew(kind, damage, whole, get, tmp_path, monkeypatch):
    place, found, made = whole
    cache = tmp_path / "cache"
    if kind in ("fmu", "note"):
        shutil.copytree(place, cache)
    else:
        shutil.copytree(place / FOLDERS[kind], cache / FOLDERS[kind])
    there = (cache / FOLDERS[kind]).iterdir()
    entry = max(p for p in there if p.is_file() and p.suffix != ".sha256")
    name = entry.name
    monkeypatch.setenv("BALLSCREW_CACHE", str(cache))
    monkeypatch.setattr(compiled_equations, "compile_library", lambda *_: made["equations"])
    monkeypatch.setattr(source_fmu, "compile_in", lambda *_: made["sources"])

    def build(_script, _others, target):
        target.write_bytes(made["fmu"])
        return target

    monkeypatch.setattr(export, "_build", build)
    DAMAGE[damage](entry)
    assert get[kind]() == found[kind]
    again = cache / FOLDERS[kind] / name
    assert kernel_cache.read(again) == (place / FOLDERS[kind] / name).read_bytes()
    before = again.stat()
    assert get[kind]() == found[kind]
    assert again.stat().st_ino == before.st_ino  # and from then on it is taken


def test_a_native_fmu_that_is_damaged_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path / "cache"))
    path = ready.ready_fmu("relay").path
    whole = path.read_bytes()
    path.write_bytes(whole[:-5000])
    assert ready.ready_fmu("relay").path.read_bytes() == whole


def test_only_the_user_can_open_what_is_made_whatever_the_umask(whole, get, tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path / "above" / "cache"))
    before = os.umask(0)
    try:
        for kind in ("component", "reference", "fmu"):
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
    "a group can write the cache": (".", lambda path: path.chmod(0o770)),
    "all can write a folder in it": ("equations", _all_can_write),
    "all can write the folder above": ("..", _all_can_write),
}
if os.getuid() == 0:
    UNSAFE["the cache belongs to another"] = (".", lambda path: os.chown(path, NOBODY, NOBODY))
    UNSAFE["a folder in it belongs to another"] = (
        "equations",
        lambda path: os.chown(path, NOBODY, NOBODY),
    )
    UNSAFE["the folder above belongs to another"] = (
        "..",
        lambda path: os.chown(path, NOBODY, NOBODY),
    )


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


def test_a_library_in_the_users_own_cache_is_loaded(planted, load):
    """Else the tests above would prove nothing."""
    assert load(planted)[2] == 66


def test_a_library_that_was_cut_short_ends_no_process(planted, load):
    (library,) = (planted / "equations").glob("*.so")
    with library.open("r+b") as stream:
        stream.truncate(library.stat().st_size // 2)  # the loader would meet SIGBUS
    (folder, _), said, code = load(planted)
    assert (folder, said, code) == (planted, "", 0)


def test_a_link_to_a_cache_is_followed_once(above, load):
    cache = above / "cache"
    (above / "link").symlink_to(cache)
    cache.mkdir(mode=0o700)
    assert load(above / "link")[0][0] == cache
