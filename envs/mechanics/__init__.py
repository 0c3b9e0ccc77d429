"""What plants are put together with: forces of contact and friction, rigid links, the system.

Knows mechanics in general and no plant, integrator or engine by name.
"""
