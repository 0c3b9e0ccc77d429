"""Arguments that take a step through its every part."""

from __future__ import annotations

VARIANTS = {
    "plain": {},
    "sub-steps": {"dt": 0.005, "control_period": 0.02},
    "late and slow": {
        "dt": 0.005, "control_period": 0.02, "action_latency": 0.01, "sensor_period": 0.03,
        "fallback": "zero",
    },
    "later than a decision": {
        "dt": 0.01, "control_period": 0.02, "action_latency": 0.05, "sensor_period": 0.04,
    },
    "lossy": {
        "dt": 0.01, "control_period": 0.03, "action_latency": 0.02, "latency_jitter": 0.05,
        "hold_probability": 0.3,
    },
    "limited": {"dt": 0.02, "max_speed": 3.0, "damping": 0.1},
}  # fmt: skip

SOFT = {
    "IntegHopper-v0": {
        "foot_mass": 8.0, "leg_stiffness": 500.0, "ground_stiffness": 500.0, "friction_speed": 5.0,
    }
}  # fmt: skip
"""What makes an environment's motion stable, so that rounding does not grow, at steps of 0.04 s."""
