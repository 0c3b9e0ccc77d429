"""Drake: the plant as a `MultibodyPlant`, and its integrators made to take steps of one size."""
