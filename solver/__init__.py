from .kernel_cache import ready

ready()
