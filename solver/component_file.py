"""A component from a user's own Python file, named ``path/to/file.py:function``.

The file is run as Python runs a script: its folder comes first on the path, so that it can import
files next to it. Afterwards `sys.path` and `sys.modules` are restored, so that two
files, or two helpers in two folders, may have the same name.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NoReturn

from .errors import ContractError, nearest

if TYPE_CHECKING:
    from .component import Component

_LOADED: dict[str, Component] = {}
_LOCK = threading.RLock()  # the path and the modules belong to the whole process


def names_file(part: str) -> bool:
    """Whether a part's name is a Python file: ``FILE.py:FUNCTION``, or one half of this."""
    return _split(part)[0].endswith(".py")


def read_component(part: str) -> Component:
    """Run a file, named ``path/to/file.py:function``, and call its function without arguments.

    Raises
    ------
    ContractError
        With the name of the file, and the line if there is one.
    """
    path, function = _split(part)
    with _LOCK:
        _LOADED[part] = _run(Path(path), function)
    return _LOADED[part]


def load_component(part: str) -> Component:
    """The component from the last reading of the file; read now if it was not read before.

    One run uses the same equations everywhere, even if the file is edited meanwhile.
    """
    return _LOADED[part] if part in _LOADED else read_component(part)


def remember_component(part: str, made: Component) -> None:
    """Use what another process read from a file as its content."""
    _LOADED[part] = made


def name_in_memory(made: Component) -> str:
    """A part's name for a component without a file; the same equations give the same name.

    It looks like a file's function, so that it is accepted wherever names are, also in other
    processes.
    """
    part = f"in memory/{made.digest}.py:{made.name}"
    remember_component(part, made)
    return part


def _split(part: str) -> tuple[str, str]:
    """Path and function; no function if the name has none."""
    path, colon, function = part.rpartition(":")
    return (path, function) if colon and path.endswith(".py") else (part, "")


def _run(path: Path, function: str) -> Component:
    from .component import Component

    try:
        source = path.read_bytes()
        folder = Path(os.path.realpath(path)).parent
    except FileNotFoundError:
        raise ContractError(f"there is no file {path}") from None
    except OSError as error:
        raise ContractError(f"{path} cannot be read: {error.strerror}") from None
    module = ModuleType(f"component_file_{path.stem}")
    module.__file__ = str(folder / path.name)
    # output of the file is not a result of the command
    with _importable(folder), contextlib.redirect_stdout(sys.stderr):
        sys.modules[module.__name__] = module  # dataclasses look their module up there
        try:
            # compiled here, since Python's own cache misses an edit within the same second
            exec(compile(source, str(path), "exec"), module.__dict__)
        except (Exception, SystemExit) as error:
            _refuse(path, folder, error, "it cannot be imported")
        make = _function(path, module, function)
        try:
            made = make()
        except (Exception, SystemExit) as error:
            _refuse(path, folder, error, f"{function}() failed")
    if not isinstance(made, Component):
        text = " ".join(repr(made).split())
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise ContractError(
            f"{path}: {function}() returned {shown}, which is a {type(made).__name__}; expected a "
            "Component"
        )
    return made


def _function(path: Path, module: ModuleType, name: str) -> Callable[[], object]:
    """The function of this name, which can be called without arguments."""
    names = [n for n, thing in vars(module).items() if callable(thing)]
    own = [n for n in names if getattr(getattr(module, n), "__module__", "") == module.__name__]
    has = f"it has {', '.join(own) or 'none'}"
    if not name:
        raise ContractError(
            f"{path}: give the function that makes the component, such as {path}:FUNCTION; {has}"
        )
    if not hasattr(module, name):
        raise ContractError(f"{path} has no function {name!r}{nearest(name, own) or f'; {has}'}")
    made: object = getattr(module, name)
    if not callable(made):
        raise ContractError(
            f"{path}: {name} is {made!r}; expected a function without arguments that returns a "
            "Component"
        )
    try:
        inspect.signature(made).bind()
    except TypeError as error:
        raise ContractError(
            f"{path}: {name} is called without arguments: {error}; give it a default"
        ) from None
    except ValueError:
        pass  # Python does not know its arguments
    return made


def _refuse(path: Path, folder: Path, error: BaseException, what: str) -> NoReturn:
    """Say in one line what failed, and where in the user's own files."""
    frames = [(f.filename, f.lineno) for f in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        frames.append((error.filename, error.lineno))
    text = " ".join((error.msg if isinstance(error, SyntaxError) else str(error)).split())
    if not isinstance(error, ContractError):  # whose text is complete
        text = ": ".join(filter(None, (what, type(error).__name__, text)))
    shown = {str(path): path}
    for file, _ in frames:
        if Path(file).parent == folder:
            shown[file] = path.parent / Path(file).name
    where, line = next(((f, n) for f, n in reversed(frames) if f in shown), (str(path), None))
    at = f", line {line}" if line else ""
    raise ContractError(f"{shown[where]}{at}: {text}") from error


@contextlib.contextmanager
def _importable(folder: Path) -> Iterator[None]:
    """Let modules next to a file be imported, and restore path and modules afterwards.

    An imported module from elsewhere with the name of one next to the file is hidden
    meanwhile. Python's own and installed modules are not hidden: other modules refer to them.
    """
    paths, before, writes = list(sys.path), dict(sys.modules), sys.dont_write_bytecode
    roots = {name.partition(".")[0] for name in before}
    out_of_sight = {root for root in roots if _is_hidden(root, folder)}
    hidden = [name for name in before if name.partition(".")[0] in out_of_sight]
    for name in hidden:
        del sys.modules[name]
    importlib.invalidate_caches()  # a helper may have been written a moment ago
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        theirs = {folder, *(Path(os.path.realpath(p)) for p in sys.path if p not in paths)}
        sys.path[:], sys.dont_write_bytecode = paths, writes
        new = {name.partition(".")[0] for name in sys.modules} - (roots - out_of_sight)
        gone = {root for root in new if _place(root) in theirs}
        for name in [n for n in sys.modules if n.partition(".")[0] in gone]:
            del sys.modules[name]
        sys.modules.update({name: before[name] for name in hidden})


def _is_hidden(root: str, folder: Path) -> bool:
    if root in sys.stdlib_module_names or root in ("ballscrew", "__main__"):
        return False
    if not ((folder / f"{root}.py").is_file() or (folder / root / "__init__.py").is_file()):
        return False
    place = _place(root)
    return place is None or not {"site-packages", "dist-packages"} & set(place.parts)


def _place(root: str) -> Path | None:
    """The folder in which a module or package that is imported was found."""
    module = sys.modules.get(root)
    file = getattr(module, "__file__", None)
    if inside := list(getattr(module, "__path__", [])):
        return Path(os.path.realpath(inside[0])).parent
    return Path(os.path.realpath(file)).parent if file else None
