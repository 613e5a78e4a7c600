"""Commands that repeat each line of the page: a command of ballscrew, or a part of this proof."""

from __future__ import annotations

_STEP = "--coupling monolithic --step 1e-3 --stop 20"
_HATS = "--set controller.sigma0_hat={} --set controller.sigma1_hat={}"
_SYSTEM_1 = _HATS.format("66967.331", "355.76")
_SYSTEM_2 = _HATS.format("66966.331", "349.41")
# results of `ballscrew.controllers.nctf.design` for the perturbed plants
_GAINS = "--set controller.c={} --set controller.Kp={} --set controller.Ki={}"
_NCTF_70 = _GAINS.format("9.55252", "526.273", "2631.36")
_NCTF_130 = _GAINS.format("16.7594", "299.964", "1499.82")

_PARTS = {
    "parameters": "B1 B2 D1 D4 E1 E2 E7 E8 G1 G2 G3 G4",
    "concept": "A1 A2",
    "friction_model": "B3",
    "linearization": "C3 C7 C8",
    "coasting": "D2 D3 D6",
    "nctf": "D5 D9 D11",
    "spectra": "E5 E6 E13",
    "plane": "F1 F2 F3 F4 F5 F6 F7 F8 F9",
    "tables": "G7 G8 G9 G10 G11 G12 G13 G14",
}
_COMMANDS = {
    f"ballscrew run --controller iol {_STEP} --out out/iol": "C1 C2 C4 C5 C6",
    f"ballscrew run --controller nctf {_STEP} --out out/nctf": "D7 D8 D10",
    f"ballscrew run --controller iol {_STEP} {_SYSTEM_1} --out out/system_1": "E3",
    "ballscrew lyapunov --controller iol --stop 300 --out out/limits": "A3",
    f"ballscrew lyapunov --controller iol --stop 20 {_SYSTEM_1} --out out/system_1_20": "E4",
    f"ballscrew lyapunov --controller iol --stop 20 {_SYSTEM_2} --out out/system_2_20": "E9 E11 "
    "E12",
    f"ballscrew lyapunov --controller iol --stop 300 {_SYSTEM_2} --out out/system_2_300": "E10",
    f"ballscrew lyapunov --controller nctf --stop 300 {_NCTF_70} --out out/nctf_70": "G5",
    f"ballscrew lyapunov --controller nctf --stop 300 {_NCTF_130} --out out/nctf_130": "G6",
}
REPEATS = {
    label: command
    for command, labels in [
        *(
            (f"python proofs/reproduction.py --only {part}", lines)
            for part, lines in _PARTS.items()
        ),
        *_COMMANDS.items(),
    ]
    for label in labels.split()
}
"""The command of each line, by its label."""
