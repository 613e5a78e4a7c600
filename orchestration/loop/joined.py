"""Both sides of a closed loop, open and joined: what a pair of parts and an .ssp both become."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...fmus.reading import Description
from ...plant.instruments import NOMINAL_VOLTAGE, UNLIMITED
from ...solver.errors import CouplingError
from ..fmu.fmu_instance import FmuInstance, Instance, Value
from ..fmu.isolated import IsolatedInstance
from ..fmu.limits import FIRST_STEP
from ..fmu.trials import check_state
from ..fmu.wiring import Wiring
from ..master.loop_run import LoopRun
from ..master.march import Progress
from ..master.master import run_loop
from ..master.reference_signal import Reference
from ..master.sides import Sides
from ..master.step_choice import MOST, MOST_OF_ISOLATED, StepChoice, choose_step, only_step
from .catalogue import AMPLIFIER, LIMIT
from .loop import HowCoupled
from .metrics import coarse_notes

Fmu = FmuInstance | IsolatedInstance
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Joined:
    """Both sides of a loop, not initialized, and what runs of them need."""

    fmus: Mapping[str, Fmu]  # all of them, by name
    values: Mapping[str, Values]  # of each of them
    main: str  # the plant among them
    sides: tuple[Instance, Instance]  # plant and controller, alone or within a group
    side_values: tuple[Values, Values]
    wiring: Wiring
    names: Mapping[str, str]  # of ports, in the results
    reference: Reference
    stop: float  # [s]
    finish: Callable[[LoopRun], LoopRun]  # a run in the units of the results
    notes: tuple[str, ...]
    limit_option: str  # how the user gives the plant a limit of its command
    sampled: Mapping[str, float]  # periods of FMUs that are stepped at their samples only [s]

    def run_at(
        self,
        how: HowCoupled,
        step: float,
        progress: Progress | None = None,
        look_again: bool | Callable[[LoopRun], bool] = True,
    ) -> LoopRun:
        """Run both sides once; for another run they are `reopened`."""
        self._check_states(step)
        sides = Sides(
            *self.sides,
            self.reference,
            self.stop,
            how.coupling,
            how.corrections,
            how.adaptive,
            self.side_values,
            self.names,
            self.wiring,
        )
        run = run_loop(sides, step, progress=progress, look_again=look_again)
        return limited(self.finish(run), self.values[self.main])

    def run(
        self, how: HowCoupled, progress: Progress | None
    ) -> tuple[LoopRun, StepChoice | None, tuple[str, ...]]:
        """Run with the requested step, else with that of the FMUs, else as by `choose_step`.

        Also returns how the step was chosen, and notes.
        """
        stepped = {
            f.path.name: f.description for n, f in self.fmus.items() if n not in self.sampled
        }
        own = 0.0 if how.step else own_step(stepped)
        first = min(FIRST_STEP, self.stop)
        step = how.step or own or first
        states = self._check_states(step)
        with contextlib.ExitStack() as opened:
            unused = [self]

            def run_at(step: float, look_again: bool | Callable[[LoopRun], bool]) -> LoopRun:
                opened.close()  # what the run before has opened
                joined = unused.pop() if unused else opened.enter_context(self._reopened())
                return joined.run_at(how, step, progress, look_again)

            choice = None
            if how.step is not None or how.adaptive:
                run = run_at(step, True)
            elif own:
                run, choice = only_step(run_at(own, True), own)
            else:
                # a call of an FMU in its own process takes much longer
                slow = any(isinstance(f, IsolatedInstance) for f in self.fmus.values())
                most = MOST_OF_ISOLATED if slow else MOST
                run, choice = choose_step(run_at, first, most)
        step = choice.step if choice else step
        return run, choice, (*self.notes, *states, *self._notes_on(run, step))

    def _check_states(self, step: float) -> tuple[str, ...]:
        checked = [check_state(f, self.values[n], self.stop, step) for n, f in self.fmus.items()]
        return tuple(note for notes in checked for note in notes)

    @contextlib.contextmanager
    def _reopened(self) -> Iterator[Joined]:
        with contextlib.ExitStack() as opened:
            sides = []
            for side in self.sides:
                sides.append(side.reopened())
                opened.callback(sides[-1].close)
            yield replace(self, sides=(sides[0], sides[1]))

    def _notes_on(self, run: LoopRun, step: float) -> Iterator[str]:
        for name, fmu in self.fmus.items():
            asked, size = self.sampled.get(name, step), fmu.description.step_size
            if not fmu.description.steps_vary and size != asked:
                yield (
                    f"{fmu.path.stem} requires steps "
                    f"{f'of {size:g} s' if size else 'of constant length'}; this run and its "
                    "checks use other steps, so do not rely on the verdict alone"
                )
        for fmu in self.fmus.values():
            yield from fmu.notes
        yield from coarse_notes(run, self.reference)
        plant = self.fmus[self.main].parameters
        yield from amplifier_notes(run, plant, self.limit_option)


def own_step(fmus: Mapping[str, Description]) -> float:
    """The step of FMUs with fixed steps [s]; 0 if there are none.

    Raises
    ------
    CouplingError
        If two of them have different steps.
    """
    sizes = {n: a.step_size for n, a in fmus.items() if not a.steps_vary and a.step_size}
    if len(set(sizes.values())) > 1:
        told = " and ".join(f"{name} of {size:g} s" for name, size in sizes.items())
        raise CouplingError(f"no common step exists: {told} allow only this step")
    return next(iter(sizes.values()), 0.0)


def limited(run: LoopRun, values: Values) -> LoopRun:
    """The run with the limit of its plant, from the plant's values."""
    limit = values.get(LIMIT, UNLIMITED)
    return run if isinstance(limit, str) else replace(run, limit=limit)


def amplifier_notes(run: LoopRun, parameters: Iterable[str], option: str) -> tuple[str, ...]:
    """A note if the command exceeds the limit of the nominal amplifier; `option` sets one."""
    limit = run.limit
    of_motor = {LIMIT, AMPLIFIER} <= {*parameters}
    if not of_motor or "u" not in run.commands or limit <= NOMINAL_VOLTAGE:
        return ()
    peak = float(np.max(np.abs(run.commands["u"])))
    if not peak > NOMINAL_VOLTAGE or run.stopped:  # the peak of a diverged loop is meaningless
        return ()
    has = "has no limit" if limit >= UNLIMITED else f"is limited to {limit:g} V"
    return (
        f"the peak of {peak:.4g} V is more than the {NOMINAL_VOLTAGE:g} V of the nominal "
        f"amplifier, and this run {has}; with {option}{NOMINAL_VOLTAGE:g} the motor would get at "
        f"most {NOMINAL_VOLTAGE:g} V",
    )
