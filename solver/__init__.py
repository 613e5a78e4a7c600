from .writable_cache import ready

ready()
