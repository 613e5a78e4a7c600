"""A controller swap study: tune all controllers alike, judge them on unseen plants and motions.

`plan.py` reads the plan, `loop.py` runs one loop, `figures.py` measures a run, `tuning.py` tunes,
`comparison.py` compares, `sensitivity.py` finds what matters, `study.py` does the whole study.
"""
