"""What trainers have in common: configuration, runs side by side, evidence, errors."""
