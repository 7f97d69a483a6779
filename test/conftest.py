from __future__ import annotations

from hypothesis import HealthCheck, settings

# An example that takes long says that the machine is busy, and nothing about flexarm.
settings.register_profile("flexarm", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("flexarm")
