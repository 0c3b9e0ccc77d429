"""What the trainer with stable-baselines3 stands on: vector environments, models, progress."""
