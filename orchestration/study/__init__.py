"""A controller swap study: tune all controllers alike, judge them on unseen plants and motions.

`study.py` does the whole study: `plan.py` reads the plan, `values.py` is a controller in its loop,
`loop.py` runs it, `figures.py` measures a run, `tuning.py` tunes, `comparison.py` compares,
`sensitivity.py` finds what matters.
"""
