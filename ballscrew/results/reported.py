"""Results that write a page, too: verdict, courses, figures, values used, and the command."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..orchestration.loop import Loop, SystemLoop
from ..orchestration.page import REPORT, Figure, page, write_page
from ..orchestration.pictures import drawing
from ..orchestration.shown_units import quantity
from .result import Result

if TYPE_CHECKING:
    from ..orchestration.parameter_file import Value
    from ..solver.kernel import ParameterInfo

_COLUMNS = ("parameter", "value", "unit", "default", "95 % interval", "from", "meaning")


@dataclass(frozen=True)
class Table:
    """A table of a page; `changed` are the rows whose value is not the default."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    changed: frozenset[int] = frozenset()


class Reported(Result):
    """A result that writes ``report.html`` beside its files.

    Attributes
    ----------
    kind : str
        What the page is about.
    function : str
        The function of Python that gives such a result.
    """

    kind: ClassVar[str]
    function: ClassVar[str]

    def badge(self) -> tuple[str, bool]:
        """One word on the result, and whether it is a good one."""
        good = bool(self.trusted)  # type: ignore[attr-defined]
        return "trusted" if good else "not trusted", good

    def verdict_and_reason(self) -> tuple[str, str]:
        """The headline of the page, and what it rests on."""
        return self.headline(), ""

    def doubts(self) -> Iterable[str]:
        """What weakens the result, beside its reason."""
        raise NotImplementedError

    def page_pictures(self) -> list[Figure]:
        """As plotly's figures."""
        raise NotImplementedError

    def tables(self) -> list[Table]:
        """All numbers of the result."""
        raise NotImplementedError

    def values_used(self) -> list[Table]:
        """Parameters with units, and which are not the default."""
        raise NotImplementedError

    def report(self, command: str = "") -> str:
        """The page as text; `command` is what made the result, if it was not Python."""
        pictures = self.page_pictures()
        headline, reason = self.verdict_and_reason()
        badge, good = self.badge()
        return page(
            __package__,
            "report.html.jinja",
            pictures,
            pictures=pictures,
            kind=self.kind,
            badge=badge,
            good=good,
            headline=headline,
            reason=reason,
            doubts=list(self.doubts()),
            figures=self.tables(),
            values=self.values_used(),
            command=command,
            function=self.function,
        )

    def save(self, folder: Path | str, pictures: bool = True, command: str = "") -> None:
        """As `Result.save`, and with the pictures ``report.html``, the page of the result.

        Parameters
        ----------
        folder : path-like
            Made where it is not there.
        pictures : bool
            Whether to write figures and the page, too.
        command : str
            What the page says that the result was made by. Default: the function of Python.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        super().save(folder, pictures)
        if pictures:
            self.save_report(Path(folder), command)

    def save_report(self, folder: Path, command: str = "") -> None:
        """Write ``report.html`` alone; raises OSError if it cannot be written."""
        with drawing(REPORT):
            write_page(folder, self.report(command))


def figures_table(title: str, figures: Mapping[str, Any], units: Mapping[str, str]) -> Table:
    """All figures of a JSON file with their units, by name."""
    rows = [
        (name.replace("_", " "), told(value, units.get(name, _unit_in(name))))
        for name, value in figures.items()
    ]
    return Table(title, ("figure", "value"), rows)


def told(value: Any, unit: str = "") -> str:
    """A figure of a JSON file, for a reader."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return quantity(value, unit)
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {told(part, unit)}" for name, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(told(part, unit) for part in value) or "-"
    return str(value or "-")


def _unit_in(name: str) -> str:
    """The unit that the name of a figure ends with, as ``period_s``."""
    ends = {"_bits_per_s": "bits/s", "_nats_per_s": "nats/s", "_bits": "bits", "_s": "s"}
    return next((unit for end, unit in ends.items() if name.endswith(end)), "")


def values_of(loop: Loop | SystemLoop, coupled: bool = True) -> list[Table]:
    """The settings of a loop, and the values of its parts; not `coupled` ones have one solver."""
    if isinstance(loop, SystemLoop):
        rows = [(name, told(value)) for name, value in loop.values.items()]
        named = Table("Given to the system; its file says the others", ("name", "value"), rows)
        return [_settings(loop, {"system": loop.label}, coupled), named]
    file = loop.parameters()
    parts = {"plant": loop.plant.label, "controller": loop.controller.label}
    tables = [_settings(loop, parts, coupled)]
    own = file.controllers[loop.controller.label]
    for side, part, values, given in (
        ("Plant", loop.plant, {**file.plant, **file.found}, loop.plant_values),
        ("Controller", loop.controller, own, loop.controller_values),
    ):
        if values:
            title = f"{side} {part.label}"
            tables.append(_values_table(title, part.settable(given), values, given))
    return tables


def _values_table(
    title: str,
    known: Mapping[str, ParameterInfo],
    values: Mapping[str, Value],
    given: Mapping[str, float],
) -> Table:
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
    return Table(title, _COLUMNS, rows, frozenset(changed))


def _unit_of_goal(loop: Loop | SystemLoop) -> str:
    """Of the position, where the plant's equations say it; a set-point is always in SI units."""
    if isinstance(loop, SystemLoop) or not loop.plant.has_equations:
        return "[SI]"
    return next((o.unit for o in loop.plant.kernel.outputs if o.name == "x"), "m")


def _settings(loop: Loop | SystemLoop, parts: Mapping[str, str], coupled: bool) -> Table:
    goal = loop.reference
    if goal is None:
        said = "as the file says"
    else:
        ends = sorted({float(goal.values.min()), float(goal.values.max())})
        said = " to ".join(quantity(value, _unit_of_goal(loop)) for value in ends)
    length = "as the file says" if loop.stop is None else f"{loop.stop:g} s"
    rows = {**parts, "set-point": said, "length": length}
    if coupled:
        rows["communication step"] = "chosen" if loop.step is None else f"{loop.step:g} s"
        rows["coupling"] = "by rule" if loop.coupling is None else loop.coupling.value
    return Table("The loop", ("setting", "value"), list(rows.items()))
