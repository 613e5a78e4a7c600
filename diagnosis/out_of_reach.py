"""Causes that the records could not have shown."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .balance import responses
from .causes import CAUSES
from .diagnosis import OutOfReach
from .explained import Explained
from .scores import Form

Vector = npt.NDArray[np.float64]

SMALLEST = 0.05  # size of a cause, as a share of friction, that should be visible
SEEN = 5.0  # standard deviations at which a cause is visible
FREED = 0.1  # relative error of a freed value that should be visible


def out_of_reach(found: Explained) -> tuple[OutOfReach, ...]:
    """Causes that would not be visible with an effect of a twentieth of the friction."""
    study = found.study
    named, variance = {m.name for m in found.built}, found.variance
    out = []
    for cause in CAUSES.values():
        if cause.name in named:
            continue
        because = cause.beyond(study.courses, study.model)
        if because:
            out.append(OutOfReach(cause.name, because))
            continue
        mine = [f for f in found.catalogue.forms if f.name == cause.name]
        shown = max((_shows(found, f, variance) for f in mine), default=0.0)
        if shown == 0.0:
            out.append(OutOfReach(cause.name, "the motion does not excite it"))
        elif shown < SEEN:
            out.append(
                OutOfReach(
                    cause.name,
                    f"at {100 * SMALLEST:.0f} % of the friction it would be visible with "
                    f"{shown:.2g} standard deviations only; {SEEN:g} are required",
                )
            )
    return tuple(out)


def _shows(found: Explained, form: Form, variance: Vector) -> float:
    """Size of a form in standard deviations of its estimate, with the model's values fitted."""
    information = found.catalogue.information(form, variance)
    if form.freed:
        return float(FREED * np.sqrt(information.max(initial=0.0)))
    study = found.study
    parts = np.concatenate(responses(study.courses, study.model, form.shape))
    size = np.sqrt(np.mean(parts**2, axis=0)).max(axis=0)
    amplitude = SMALLEST * study.model.friction_scale / np.maximum(size, 1e-300)
    return float(np.max(amplitude * np.sqrt(information) * (size > 0.0), initial=0.0))
