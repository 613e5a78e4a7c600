"""A continuous law as a computer runs it: it reads at sample instants and holds its commands."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, ContractError, DiscreteState, Parameter, symbol

PERIOD = Parameter("sample_time", 1e-3, "s", "sampling period", "a common servo rate", minimum=1e-6)


def sampled_and_held(
    controller: Component, name: str, sample_time: Parameter = PERIOD
) -> Component:
    """The controller between samplers of its measurements and holds of its commands.

    At a sample instant the measurements are read, and the commands that follow from them, and from
    the controller's own states then, are held until the next. Its states go on meanwhile with the
    measurements that were read.

    Parameters
    ----------
    controller : Component
        Continuous, without modes.
    name : str
        Of the sampled one.
    sample_time : Parameter

    Raises
    ------
    ContractError
        For a controller that is sampled already or has modes.
    """
    if controller.discrete or controller.modes:
        what = "discrete states" if controller.discrete else "modes"
        raise ContractError(f"{controller.name} has {what}; only a continuous law can be sampled")
    used = controller.used_symbols()
    read = [i for i in controller.inputs if i.role == "measurement" and symbol(i.name) in used]
    held = {symbol(i.name): symbol(f"{i.name}_read") for i in read}
    fields = controller.equations_with(held)
    return replace(
        controller,
        name=name,
        description=f"{controller.description}; sampled, its output held between samples",
        states=fields["states"],
        balances=fields["balances"],
        discrete=(
            *(
                DiscreteState(
                    f"{i.name}_read",
                    i.unit,
                    f"{i.meaning}, at the last sample",
                    symbol(i.name),
                    i.start,
                    i.nominal,
                )
                for i in read
            ),
            *(
                DiscreteState(
                    f"{o.name}_held",
                    o.unit,
                    f"{o.meaning}, since the last sample",
                    sp.sympify(o.value),
                    nominal=o.nominal,
                )
                for o in controller.all_outputs
            ),
        ),
        outputs=tuple(replace(o, value=symbol(f"{o.name}_held")) for o in controller.outputs),
        sample_time=sample_time,
    )
