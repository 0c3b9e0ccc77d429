"""Training: PPO with stable-baselines3, baseline controllers and the policy file."""
