"""Friction that oscillates along the travel, with the turns of the screw or of the balls.

It changes its sign with the velocity.
"""

from __future__ import annotations

from .cause import Cause, Mechanism, force, parameter
from .travel import changing, either_way, periods, viscous_share, waves

_SHARE = "periodic_viscous_share"
_TURNS = (1, 2)  # periods per turn of the screw


def _swinging(per_metre: str, harmonics: tuple[int, ...]) -> Mechanism:
    return force(
        {
            parameter(
                f"friction_{wave.name}", "1", f"share of friction with the {wave.kind}"
            ): changing(_SHARE, wave.course)
            for wave in waves(per_metre, harmonics)
        },
        (parameter(per_metre, "1/m", "periods per metre", 1.0), viscous_share(_SHARE)),
        lambda courses, model: either_way(periods(courses, model, per_metre, _TURNS), _SHARE),
        per_record=True,
    )


CAUSE = Cause(
    "position_periodic_friction",
    "friction varies periodically along the travel, for example once per turn of the screw",
    (_swinging("periods_per_metre", (1,)), _swinging("double_periods_per_metre", (1, 2))),
    confirm="move slowly over a few turns in both directions: the periodic part changes sign with "
    "the direction",
    mistaken_for=("torque_ripple",),
)
