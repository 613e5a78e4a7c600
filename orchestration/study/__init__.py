"""A controller swap study: tune all controllers alike, judge them on unseen plants and motions.

`study.py` does the whole study: `plan.py` reads the plan, `loop.py` runs a loop, `figures.py`
measures a run, `tuning.py` tunes, `statistics.py` compares and finds what matters.
"""
