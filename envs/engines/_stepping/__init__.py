"""What all engines share: the control period, its steps, and calls that leave the process alone."""
