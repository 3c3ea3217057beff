"""Examples that hypothesis draws are the same in every run; `--hypothesis-profile=default` draws others."""

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")
