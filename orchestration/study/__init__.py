"""A controller swap study: tune all alike, judge on what was never seen, say what can be told.

`plan.py` is what is asked, `loop.py` runs one loop, `figures.py` measures a run, `tuning.py` tunes,
`comparison.py` compares, `sensitivity.py` says what matters, `study.py` does all of it.
"""
