"""One line of the page: a claim of the thesis, and the result of this program."""

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
        The claim.
    thesis, here : str
    rule : str
        Condition under which both agree.
    agrees : bool
    why : str
        Explanation; needed if they differ.
    printed : bool
        False if the thesis prints no comparable result. The line is then shown but not counted.
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
        """Text of the last column of the page."""
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
