"""What all results share, and the tables that several of them have."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from pathlib import Path
from typing import Any, ClassVar, Self

from .orchestration.loop.loop import HowCoupled, Loop, SystemLoop
from .orchestration.loop.parameter_file import TURNS, Value
from .orchestration.loop.parts import Part
from .orchestration.loop.pictures import drawing, inline, write_figure
from .orchestration.loop.shown import REPORT, Table, page, quantity
from .orchestration.master.couplings import WITHOUT_FMUS
from .solver.files import write_atomically

_COLUMNS = ("parameter", "value", "unit", "default", "95 % interval", "from", "meaning")


class Result:
    """A result: a sentence, tables, pictures, files, a page, and a view in notebooks."""

    function: ClassVar[str]  # that gives such a result

    @classmethod
    def of(cls, computed: Any) -> Self:
        """The result with the fields of the computed object."""
        return cls(**{f.name: getattr(computed, f.name) for f in fields(computed)})

    def headline(self) -> str:
        """The result in one sentence."""
        raise NotImplementedError

    def doubts(self) -> Iterable[str]:
        """What weakens it."""
        return getattr(self, "notes", ())

    def tables(self) -> list[Table]:
        """All numbers with units, the most important table first."""
        raise NotImplementedError

    def pictures(self) -> dict[str, Any]:
        """Matplotlib figures by the names of their files, the most important first."""
        raise NotImplementedError

    @property
    def badge(self) -> str:
        """A word on the result."""
        return "trusted" if self.good else "not trusted"

    @property
    def good(self) -> bool:
        """Whether the badge is a good one."""
        return bool(getattr(self, "trusted", True))

    def save(self, folder: Path | str, pictures: bool = True, command: str = "") -> None:
        """Write plain files (CSV, JSON, TOML), the figures as PNG, and the page ``report.html``.

        Parameters
        ----------
        folder : path-like
            Created if it does not exist. An OSError says that a file cannot be written.
        pictures : bool
            Whether to write figures and page, too.
        command : str
            What the page names as its origin. Default: the function of Python.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.write(folder)
        if pictures:
            with drawing():
                figures = self._figures()
                for stem, figure in figures.items():
                    write_figure(figure, folder, stem)
            with drawing(REPORT):
                write_page(folder, self.report(command, figures))

    def write(self, folder: Path) -> None:
        """Write the plain files; raises OSError if one cannot be written."""
        super().save(folder)  # type: ignore[misc]

    def report(self, command: str = "", figures: Mapping[str, Any] | None = None) -> str:
        """The page as text, with these pictures or with all."""
        figures = self._figures() if figures is None else figures
        text = page(
            {name: inline(figure) for name, figure in figures.items()},
            kind=self.function.rpartition(".")[2],
            badge=self.badge,
            style="good" if self.good else "doubt",
            headline=self.headline(),
            doubts=list(self.doubts()),
            tables=self.tables(),
            made_by=command or self.function,
        )
        return text if self._words is str else page_in_turning_units(text)

    def plot(self) -> Any:
        """The most important figure, a `matplotlib.figure.Figure`."""
        return in_words(next(iter(self.pictures().values())), self._words)

    def say(self, text: str) -> str:
        """A text, in N*m and rad if this is about a rotating body."""
        return self._words(text)

    def _figures(self) -> dict[str, Any]:
        return {stem: in_words(f, self._words) for stem, f in self.pictures().items()}

    @property
    def _words(self) -> Callable[[str], str]:
        return words_for(getattr(self, "notes", ()))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.say(self.headline())}>"

    def _repr_html_(self) -> str:
        def listed(tag: str, texts: Iterable[str]) -> str:
            return "".join(f"<{tag}>{escape(self.say(text))}</{tag}>" for text in texts)

        rows = "".join(f"<tr>{listed('td', row)}</tr>" for row in self.tables()[0].rows)
        head, doubts = listed("b", [self.headline()]), listed("li", self.doubts())
        return f"<p>{head}</p><ul>{doubts}</ul><table>{rows}</table>"


def write_page(folder: Path, text: str) -> None:
    """Write ``report.html``; what no text may contain in the names of files becomes ``?``."""
    write_atomically(folder / REPORT, text.encode("utf-8", "replace"))


def table_of(data: Any, index: str | None = None, columns: Sequence[str] | None = None) -> Any:
    """A pandas table; pandas is imported only here."""
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install pandas") from error
    table = pd.DataFrame(data, columns=columns)
    return table if index is None else table.set_index(index)


def figures_table(title: str, figures: Mapping[str, Any], units: Mapping[str, str]) -> Table:
    """All figures of a JSON file with their units, by name."""
    rows = [
        (name.replace("_", " "), as_text(value, units.get(name, _unit_in(name))))
        for name, value in figures.items()
    ]
    return Table(title, ("figure", "value"), rows)


def as_text(value: Any, unit: str = "") -> str:
    """A figure of a JSON file, for a reader."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return quantity(value, unit)
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {as_text(part, unit)}" for name, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(as_text(part, unit) for part in value) or "-"
    return str(value or "-")


def _unit_in(name: str) -> str:
    """The unit that the name of a figure ends with, as ``period_s``."""
    ends = {"_bits_per_s": "bits/s", "_nats_per_s": "nats/s", "_bits": "bits", "_s": "s"}
    return next((unit for end, unit in ends.items() if name.endswith(end)), "")


def values_of(loop: Loop | SystemLoop, coupled: bool = True) -> list[Table]:
    """The settings of a loop, and the values of its parts; not `coupled` ones have one solver."""
    if isinstance(loop, SystemLoop):
        rows = [(name, as_text(value)) for name, value in loop.values.items()]
        named = Table("Given to the system; its file says the others", ("name", "value"), rows)
        return [_settings(loop, {"system": loop.label}, coupled), named]
    file, plant, own = loop.parameters(), loop.plant, loop.controller
    settings = _settings(loop, {"plant": plant.label, "controller": own.label}, coupled)
    tables = (
        _values_table("Plant", plant, {**file.plant, **file.found}, loop.plant_values),
        _values_table("Controller", own, file.controllers[own.label], loop.controller_values),
    )
    return [settings, *(table for table in tables if table.rows)]


def _values_table(
    side: str, part: Part, values: Mapping[str, Value], given: Mapping[str, float]
) -> Table:
    known = part.settable(given)
    rows, changed = [], set()
    for k, (name, v) in enumerate(values.items()):
        about = known.get(name)
        if name in given and (about is None or v.value != about.default):
            changed.add(k)
        ends = f"{v.interval[0]:.4g} to {v.interval[1]:.4g}" if v.interval else "-"
        default = f"{about.default:.6g}" if about and about.default == about.default else "-"
        unit = "" if v.unit == "1" else v.unit
        meaning = about.meaning if about else ""
        rows.append((name, f"{v.value:.6g}", unit, default, ends, v.source, meaning))
    return Table(f"{side} {part.label}", _COLUMNS, rows, frozenset(changed))


def _settings(loop: Loop | SystemLoop, parts: Mapping[str, str], coupled: bool) -> Table:
    how: HowCoupled = loop
    goal = loop.reference
    if goal is None:
        said = "as the file says"
    else:
        # in the unit of the position, where the plant's equations say it; always an SI unit
        unit = "[SI]"
        if isinstance(loop, Loop) and loop.plant.has_equations:
            unit = loop.plant.unit_of("x") or "m"
        ends = sorted({float(goal.values.min()), float(goal.values.max())})
        said = " to ".join(quantity(value, unit) for value in ends)
    length = "as the file says" if loop.stop is None else f"{loop.stop:g} s"
    rows = {**parts, "set-point": said, "length": length}
    if coupled:
        rows["communication step"] = "chosen" if loop.step is None else f"{loop.step:g} s"
        by_rule = "by rule" if loop.fmus else WITHOUT_FMUS
        rows["coupling"] = how.coupling.value if how.coupling else by_rule
    return Table("The loop", ("setting", "value"), list(rows.items()))


_METRES = {"m": "rad", "mm": "mrad", "um": "urad", "µm": "µrad", "nm": "nrad"}
_TURNED = {"N": "N*m", "kg": "kg*m^2", **_METRES}
# after a number or in brackets, or alone in its column, but not within a word or a file's name
_UNIT = re.compile(
    r"(?:(?<=[\d)%*] )|(?<=  )|(?<=\[))"
    r"(?:[1NVA](?:\*s)?/(?:m|mm)(?:\^2)?|(?:kg|N|mm|um|µm|nm|m)(?:/s(?:\^2)?)?)(?=$|[\s,;.:)\]])",
    re.MULTILINE,
)
_MASS = re.compile(r"(?:^|(?<=\bof ))m\b(?= {2,}| [\d(])", re.MULTILINE)


def in_turning_units(text: str) -> str:
    """Lines for a reader with N*m for N, rad for m and kg*m^2 for kg; the mass m is J."""

    def turned(unit: re.Match[str]) -> str:
        return re.sub("[A-Za-zµ]+", lambda m: _TURNED.get(m[0], m[0]), unit[0])

    return _MASS.sub("J", _UNIT.sub(turned, text))


def page_in_turning_units(page: str) -> str:
    """`in_turning_units` of what a page of HTML shows; styles and tags stay."""
    kept = re.split(r"(<style\b.*?</style>|<[^>]*>)", page, flags=re.DOTALL)
    kept[::2] = ["J" if part == "m" else in_turning_units(part) for part in kept[::2]]
    return "".join(kept)


def words_for(notes: Sequence[str]) -> Callable[[str], str]:
    """The conversion of lines for a reader: to N*m and rad if `notes` say that the body turns."""
    return in_turning_units if TURNS in notes else str


def in_words(figure: Any, words: Callable[[str], str]) -> Any:
    """The figure with all its text converted by `words`."""
    if words is str:  # nothing to do; ticks would be made before they are drawn
        return figure
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(words(text.get_text()))
    return figure
