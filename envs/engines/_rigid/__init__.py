"""A plant told to simulators of rigid bodies, in their formats, and checked against the plant."""
