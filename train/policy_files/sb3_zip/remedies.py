"""What to do about a file that is refused."""

RETRAIN = "train with PPO('MlpPolicy', ...) and save again"
DAMAGED = "save it again with model.save(path)"
