"""What any program needs: optional packages, parameters, files, processes, terminals, pages.

Lowest of all floors: it knows nothing of plants, policies or panels, and imports nothing above it.
"""
