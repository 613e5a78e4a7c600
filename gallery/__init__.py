"""Systems that are discussed in the literature, each with known results and our results.

Each system is a folder that uses only the public API: ``components.py`` has its equations,
``findings.py`` its numbers and its picture, ``page.md`` its description. To add a system, add such
a folder and a line here.
"""

SYSTEMS = {
    "belt": "friction oscillator on a moving belt: where stick-slip begins and ends",
    "inclined_spring": "mass pulled over an inclined spring: sliding or stick-slip, or both",
    "van_der_pol": "Van der Pol's oscillator: the limit cycle of the Reference-FMUs",
    "bouncing_ball": "Bouncing ball: where it ends, and how the table of the Reference-FMUs is off",
    "impact_oscillator": "Impact oscillator: grazing, chaos and period doubling at a rigid stop",
    "forced_friction": "a driven mass with dry friction: its swing, where it stops, and resonance",
    "backlash_drive": "Drive with backlash: how it hunts, against its describing function",
    "cart_pendulum": "Balanced pendulum: why it hunts where its cart has friction",
    "servo_compensation": "a servo whose friction is compensated too much, and swings",
    "pid_mass": "a mass under PID: it hunts where Fs > Fc, else its error falls as 1/time",
    "dc_motor": "a DC motor with friction under P, PD and PID: it stops short, or it hunts",
}
