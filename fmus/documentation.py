"""The HTML page inside an FMU: its equations, parameters and ports."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

from ..solver.kernel import Kernel
from .interface import Interface, Variable

if TYPE_CHECKING:
    from jinja2 import Template

# Here and not in a separate file: stored FMUs are identified by a hash of the modules' text.
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{{ kernel.name }}</title><style>
body { font-family: sans-serif; max-width: 60rem; margin: 2rem auto; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 }
td, th { border: 1px solid #bbb; padding: .25rem .6rem; text-align: left; vertical-align: top }
pre { white-space: pre-wrap }
</style></head><body>
<h1>{{ kernel.name }}</h1>
<p>{{ kernel.description }}.</p>
<h2>Equations</h2>
<pre>{{ kernel.source }}</pre>
{% for causality in ("input", "output", "parameter") %}
<h2>{{ causality | capitalize }}s</h2>
<table><tr><th>name</th><th>unit</th><th>default</th><th>range</th><th>meaning</th></tr>
{% for v in variables if v.causality == causality %}
<tr><td>{{ v.name }}</td><td>{{ v.unit }}</td><td>{{ "" if v.start is none else v.start }}</td>
<td>{{ v | limits }}</td><td>{{ v.description }}</td></tr>
{% endfor %}
</table>
{% endfor %}
</body></html>
"""


def html_page(kernel: Kernel, interface: Interface) -> str:
    """The page as text; the equations are Python."""
    return _template().render(kernel=kernel, variables=interface.variables)


@functools.cache
def _template() -> Template:
    from jinja2 import Environment, StrictUndefined  # takes 50 ms, needed only for exports

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["limits"] = _limits
    return environment.from_string(_PAGE)


def _limits(v: Variable) -> str:
    unbounded = math.isinf(v.minimum) and math.isinf(v.maximum)
    return "" if unbounded else f"{v.minimum:g} to {v.maximum:g}"
