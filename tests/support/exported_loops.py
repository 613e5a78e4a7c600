"""Representative controllers, for tests that generate and compile each loop.

This takes seconds per loop. As parts, all controllers are in every suite.
"""

IN_LOOPS = "iol iol_true_acceleration nctf pid pid_sampled iol+sampled p_pi relay".split()
IN_LOOPS += ["pid_sampled+position_encoder"]
