"""Common functions of all results: files, figures, tables, notebooks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields
from html import escape
from pathlib import Path
from typing import Any, Self

from ..orchestration.pictures import drawing, in_words, write_figure
from ..orchestration.turning_words import words_for


class Result:
    """Common functions of all results."""

    @classmethod
    def of(cls, computed: Any) -> Self:
        """The result with the fields of the computed object."""
        return cls(**{f.name: getattr(computed, f.name) for f in fields(computed)})

    def pictures(self) -> dict[str, Any]:
        """Matplotlib figures by the names of their files, the most important first."""
        raise NotImplementedError

    def headline(self) -> str:
        """The result in one sentence, with its limitations."""
        raise NotImplementedError

    def facts(self) -> Iterable[tuple[str, str]]:
        """Named numbers, as text with units."""
        raise NotImplementedError

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Write plain files (CSV, JSON, TOML) and, by default, the figures as PNG.

        Parameters
        ----------
        folder : path-like
            Created if it does not exist.
        pictures : bool
            Whether to write the figures, too.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        super().save(folder)  # type: ignore[misc]
        if pictures:
            with drawing():
                for stem, figure in self.pictures().items():
                    write_figure(in_words(figure, self._words), folder, stem)

    def plot(self) -> Any:
        """The most important figure, a `matplotlib.figure.Figure`."""
        return in_words(next(iter(self.pictures().values())), self._words)

    def say(self, text: str) -> str:
        """A text, in N*m and rad if this is about a rotating body."""
        return self._words(text)

    @property
    def _words(self) -> Callable[[str], str]:
        return words_for(getattr(self, "notes", ()))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.say(self.headline())}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{escape(self.say(value))}</td></tr>"
            for name, value in self.facts()
        )
        return f"<p><b>{escape(self.say(self.headline()))}</b></p><table>{rows}</table>"


def table_of(data: Any, index: str | None = None) -> Any:
    """A pandas table; pandas is imported only here."""
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install pandas") from error
    table = pd.DataFrame(data)
    return table if index is None else table.set_index(index)
