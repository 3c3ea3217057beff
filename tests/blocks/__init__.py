"""Examples that hypothesis draws are the same in every run; with EXAMPLES=soak they are others, and twenty times as
many.
"""

import os

from hypothesis import settings

settings.register_profile("steady", max_examples=50, derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=1000, deadline=None)
settings.load_profile(os.environ.get("EXAMPLES", "steady"))
