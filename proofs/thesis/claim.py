"""One line of the page: what the thesis claims, and what this program finds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """One line of the page.

    Attributes
    ----------
    where : str
        Section, equation, table or figure of the thesis.
    says : str
        What is claimed.
    thesis, here : str
    rule : str
        When the two agree.
    agrees : bool
    why : str
        Explanation; needed where they differ.
    printed : bool
        False where the thesis prints nothing that this program could agree with. The line is
        shown and not counted.
    """

    where: str
    says: str
    thesis: str
    here: str
    rule: str
    agrees: bool
    why: str = ""
    printed: bool = True

    @property
    def verdict(self) -> str:
        """What the last column of the page says."""
        if not self.printed:
            return "not counted" if self.agrees else "**our own check fails**"
        return "agrees" if self.agrees else "**differs**"


def number(  # noqa: PLR0913
    where: str,
    says: str,
    thesis: float,
    here: float,
    unit: str,
    within: float,
    why: str = "",
    relative: bool = False,
    digits: int = 5,
) -> Claim:
    """A claim that is a number: agrees within an absolute or relative tolerance."""
    off = abs(here - thesis) / (abs(thesis) if relative else 1.0)
    rule = f"within {within * 100:g} %" if relative else f"within {within:g} {unit}"
    text = f"{here:.{digits}g} {unit}".strip()
    return Claim(where, says, f"{thesis} {unit}".strip(), text, rule.strip(), off <= within, why)


def numbers(values: list[float]) -> str:
    return "(" + ", ".join(f"{v:.5g}" for v in values) + ")"
