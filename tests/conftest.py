"""Property tests draw the same examples everywhere; MAGLEV_CTRL_RANDOM=1 lets them draw new ones."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None, print_blob=True)
settings.register_profile("exploring", deadline=None, print_blob=True)
settings.load_profile("exploring" if os.environ.get("MAGLEV_CTRL_RANDOM") else "repeatable")
