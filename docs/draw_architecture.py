"""Draw docs/images/architecture.png: the folders, and which may import which."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

LAYERS = (
    (("solver", "equations to code, the compiled core:\nsteps, events, tangents"),),
    (
        ("instruments", "sensors, amplifier,\nfilter, delay"),
        ("plant", "friction laws,\nscrew and motor"),
        ("controllers", "control laws\nand their design"),
    ),
    (
        ("fmus", "a component as an FMU, a loop as .ssp;\nthird-party files"),
        ("records", "measured tables, units, checks"),
    ),
    (("orchestration", "couplings, master, verdict, isolation,\nruns and swaps"),),
    (
        ("stability", "exponents,\nattractors, maps"),
        ("rig", "virtual test rig,\nrecords with the truth"),
    ),
    (
        ("identification", "friction laws from records"),
        ("diagnosis", "what a model gets wrong, and why"),
    ),
    (("ballscrew", "public API, command, reports"),),
    (("gallery", "well-known systems, each with what is known of it"),),
)
FLOWS = (
    "components",
    "components",
    "FMU files, kernels, tables",
    "runs, kernels",
    "records, runs",
    "results",
    "public API",
)


def main() -> None:
    figure = Figure(figsize=(8.2, 10.9))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 14.2 * len(LAYERS))
    axes.axis("off")
    for k, layer in enumerate(LAYERS):
        low = 14.2 * (len(LAYERS) - 1 - k) + 1.5
        width = 92 / len(layer)
        for j, (name, what) in enumerate(layer):
            left = 4 + j * width
            box = {"boxstyle": "round,pad=0.1,rounding_size=0.8", "linewidth": 1.4}
            from matplotlib.patches import FancyBboxPatch

            patch = FancyBboxPatch(
                (left + 1, low), width - 2, 9.4, facecolor="#E8F1F8", edgecolor="#0072B2", **box
            )
            axes.add_patch(patch)
            middle = left + width / 2
            axes.text(middle, low + 7.2, name + "/", ha="center", weight="bold", size=12)
            axes.text(middle, low + 3.2, what, ha="center", va="center", size=10)
        if k < len(FLOWS):
            arrow = {"arrowstyle": "-|>", "color": "#D55E00", "linewidth": 1.6}
            axes.annotate("", (50, low - 4.4), (50, low - 0.3), arrowprops=arrow)
            axes.text(52, low - 2.4, FLOWS[k], va="center", size=10, color="#A84300")
    figure.savefig(Path(__file__).parent / "images" / "architecture.png", dpi=110)


if __name__ == "__main__":
    main()
