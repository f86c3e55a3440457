"""How many examples a fuzz test tries: a few hundred, or as many as SEXTANT_EXAMPLES says."""

import os

from hypothesis import HealthCheck, settings

fuzz = settings(
    max_examples=int(os.environ.get("SEXTANT_EXAMPLES", "300")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
