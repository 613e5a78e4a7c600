"""A diagnosis as one page that opens without a network, for a quick overview."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..orchestration.page import page, plotly_figure, write_page
from ..orchestration.turning_words import page_in_turning_units, words_for
from . import report_words as words
from .causes import CAUSES
from .diagnosis import Diagnosis, names_of
from .diagnosis_pictures import pictures_of, said
from .experiment_motions import COMMAND_FILE

_TEMPLATE = "report.html.jinja"
_NOT_SHOWN = 1e-9  # relative change below which a value counts as unchanged
_KINDS = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
_NOISE = {
    "force_N": ("balance of force, rms", "N"),
    "voltage_N": ("balance of voltage, converted to a force, rms", "N"),
}


def save_report(diagnosis: Diagnosis, folder: Path) -> None:
    """Write ``report.html``.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    write_page(folder, report(diagnosis))


def report(diagnosis: Diagnosis) -> str:
    """The page as text."""
    kind = diagnosis.prior.kind
    turns = diagnosis.prior.turns
    words_of_it = words_for(diagnosis.notes)
    pictures = said(pictures_of(diagnosis), words_of_it)
    text = page(
        __package__,
        _TEMPLATE,
        [plotly_figure(p) for p in pictures],
        _filters(diagnosis.prior.units),
        d=diagnosis,
        headline=words.verdict_sentence(diagnosis),
        coverage=words.SET,
        naming=words.NAMED,
        unreliable=words.DOES_NOT_HOLD if words.does_not_hold(diagnosis) else "",
        named=names_of(diagnosis.causes),
        levels=(
            ("prior model", diagnosis.baseline_residual),
            ("values adjusted within tolerance *", diagnosis.adjusted_residual),
            ("with all causes found *", diagnosis.final_residual),
            ("noise alone (floor)", diagnosis.floor),
        ),
        mistaken_for={
            c.name: CAUSES[c.name].mistaken_for if c.name in CAUSES else ()
            for c in diagnosis.causes
        },
        pictures=pictures,
        noise=_NOISE,
        kind="rotating body, driven by a torque" if turns else _KINDS.get(kind, kind),
        command_file=COMMAND_FILE,
    )
    return page_in_turning_units(text) if turns else text


def _filters(units: Mapping[str, str]) -> dict[str, Callable[..., Any]]:
    """Functions by which the template writes numbers and sentences."""
    plain = (words.as_share, words.micro, words.of_friction, words.percent)
    return {f.__name__: f for f in (*plain, words.times)} | {
        "change": lambda change: f"{100 * change:+.2g} %" if abs(change) > _NOT_SHOWN else "0",
        "interval": lambda ends: words.interval(*ends),
        "metres": words.length,
        "sentence": words.sentence_for_page,
        "unit": lambda name: units[name],
    }
