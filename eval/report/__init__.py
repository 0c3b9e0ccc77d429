"""What people see of a panel: the page and the figures, from ``panel.json`` alone.

Nothing is computed here that ``panel.json`` does not hold.
"""
